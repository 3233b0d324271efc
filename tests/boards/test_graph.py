"""Links, cells and labels on boards whose corners are known, and against slow versions among many corners."""

import heapq

import numpy as np
import pytest
from board_scene import VIEWS, View, board, scene, turn, view

from rcdn.boards import graph
from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, cells, label, links, mutual, near_pairs, slot_of


def neighbours(shown):
    """{(a, b)}: numbers of corners that are next to each other on one board, both ways round."""
    gap = np.abs(shown.ij[:, None] - shown.ij[None]).sum(axis=2)
    return set(map(tuple, np.argwhere((gap == 1) & (shown.board[:, None] == shown.board[None])).tolist()))


@pytest.mark.parametrize("name", VIEWS)
def test_links_are_the_edges_of_the_board(name):
    shown = view(name)
    field, number = shown.field()
    found = links(field)
    pairs = [(int(number[a]), int(number[b])) for a, row in enumerate(found) for b in row if b >= 0]
    assert len(pairs) == len(set(pairs))
    assert set(pairs) == neighbours(shown)


@pytest.mark.parametrize("name", VIEWS)
def test_cells_are_the_squares_turning_clockwise(name):
    shown = view(name)
    field, number = shown.field()
    quads = np.array(cells(field, links(field)))
    cols, rows = shown.sizes[0]
    assert len(quads) == (cols - 1) * (rows - 1)
    ring = shown.ij[number[quads]] - shown.ij[number[quads]].min(axis=1, keepdims=True)
    steps = np.roll(ring, -1, axis=1) - ring
    assert (np.abs(steps).sum(axis=2) == 1).all()
    x, y = steps[..., 0], steps[..., 1]
    assert (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1) == 1).all()


@pytest.mark.parametrize("name", VIEWS)
def test_one_grid_with_right_labels(name):
    shown = view(name)
    field, number = shown.field()
    (grid,) = label(field, cells(field, links(field)))
    assert sorted(number[list(grid.values())]) == list(range(len(shown)))
    ij, true = np.array(list(grid)), shown.ij[number[list(grid.values())]]
    assert any(len(np.unique(ij - turn(true, k), axis=0)) == 1 for k in range(4))


def test_two_boards_make_two_grids():
    pair = (board(5, 4, 26, 15, 20, at=(-115, 0)), board(4, 6, 24, -20, 30, at=(120, 10)))
    shown = View(scene(boards=pair))
    field, number = shown.field()
    grids = label(field, cells(field, links(field)))
    boards = [set(shown.board[number[list(g.values())]].tolist()) for g in grids]
    assert sorted(map(len, grids)) == [20, 24]
    assert boards in ([{0}, {1}], [{1}, {0}])


def test_each_slot_has_one_neighbour_and_links_are_mutual_in_clutter():
    shown = view("tilted")
    extra = np.random.default_rng(0).uniform(5, [475, 355], (200, 2))
    field, _ = shown.field(extra=extra)
    found = links(field)
    assert found.shape == (len(shown) + 200, 4)
    for a, b in np.argwhere(found >= 0):
        assert a in found[found[a, b]]


def test_no_link_where_the_picture_shows_no_edge():
    shown = view("flat")
    field, _ = shown.field()
    blank = Field(**{**vars(field), "grey": np.full_like(field.grey, 120)})
    assert (links(blank) == -1).all()


def test_no_link_between_corners_of_one_colour():
    """Printed neighbours are each other's negatives; here every second corner says otherwise."""
    shown = view("flat")
    field, number = shown.field()
    odd = shown.ij[number].sum(axis=1) % 2 == 1
    same = Field(**{**vars(field), "polarity": np.where(odd, -field.polarity, field.polarity)})
    assert (links(same) == -1).all()


def test_weak_and_unrefined_corners_have_no_links():
    shown = view("flat")
    centre = shown.index(3, 2)
    field, number = shown.field(weak=[centre])
    at = int(np.flatnonzero(number == centre)[0])
    found = links(field)
    assert (found[at] == -1).all()
    assert at not in found
    refined = np.arange(len(number)) != at
    found = links(Field(**{**vars(field), "strong": np.ones(len(number), bool), "refined": refined}))
    assert (found[at] == -1).all()


@pytest.mark.parametrize("count", range(4))
def test_too_few_corners(count):
    shown = view("flat")
    field, _ = shown.field()
    few = Field(field.grey, *(v[:count] for k, v in vars(field).items() if isinstance(v, np.ndarray) and k != "grey"))
    assert links(few).shape == (count, 4)
    assert (links(few) == -1).all()
    quads = cells(few, links(few))
    assert quads.shape == (0, 4)
    assert label(few, quads) == []


def lattice_field(xy, response):
    n = len(xy)
    return Field(np.zeros((9, 9)), np.asarray(xy, float), np.zeros((n, 2)), np.ones(n, int), np.ones(n), np.ones(n),
                 np.asarray(response, float), np.ones(n, bool), np.ones(n, bool))  # fmt: skip


def test_a_cell_that_contradicts_its_grid_is_left_out():
    """Corners 0 1 2 / 3 4 5, and a false cell behind the edge 2–5 that closes the grid to a ring."""
    field = lattice_field(np.zeros((6, 2)), np.ones(6))
    good = np.array([(0, 1, 4, 3), (1, 2, 5, 4)])
    wanted = {(0, 0): 0, (1, 0): 1, (2, 0): 2, (0, 1): 3, (1, 1): 4, (2, 1): 5}
    assert label(field, good) == [wanted]
    assert label(field, np.array([*good, (2, 0, 3, 5)])) == [wanted]


def test_the_surest_cell_starts():
    """Two grids that share no edge: the one with the better corners is first."""
    field = lattice_field(np.zeros((8, 2)), [0.5] * 4 + [0.9] * 4)
    first, second = label(field, np.arange(8).reshape(2, 4))
    assert set(first.values()) == {4, 5, 6, 7}
    assert set(second.values()) == {0, 1, 2, 3}


def test_edge_contrast_of_a_step():
    """Bright below y = 20: at rising angle from the direction +x, which is clockwise on the screen."""
    grey = np.zeros((40, 60), np.uint8)
    grey[20:] = 100
    start, end = np.array([[10.0, 19.5], [50, 19.5], [10, 5]]), np.array([[50.0, 19.5], [10, 19.5], [50, 5]])
    np.testing.assert_allclose(edge_contrast(grey, start, end), [[100] * 3, [-100] * 3, [0] * 3], atol=1e-3)
    assert edge_contrast(grey, start[:0], end[:0]).shape == (0, 3)


# ---- against slow versions


def crowd(seed, spread=25.0, count=300):
    """A field of corners on a lattice of squares, each a little off its place,
    in a picture of those squares; some are no corners."""
    rng = np.random.default_rng(seed)
    n = int(np.sqrt(count))
    ij = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2)
    xy = 20 + spread * ij + rng.normal(0, 0.05 * spread, ij.shape)
    y, x = np.mgrid[: int(40 + spread * n), : int(40 + spread * n)]
    grey = np.where((np.floor((x - 20) / spread) + np.floor((y - 20) / spread)) % 2 == 0, 200, 40).astype(np.uint8)
    axes = np.sort(np.array([0, np.pi / 2]) + rng.normal(0, 0.12, (len(xy), 2)), axis=1) % np.pi
    polarity = np.where(ij.sum(axis=1) % 2 == 0, 1, -1) * rng.choice([1, -1, 0], len(xy), p=[0.92, 0.04, 0.04])
    contrast, response = rng.uniform(50, 200, len(xy)), rng.choice([0.5, 0.7, 0.9], len(xy))
    strong, refined = rng.uniform(size=(2, len(xy))) < 0.97
    return Field(grey, xy, axes, polarity, contrast, np.ones(len(xy)), response, strong, refined)


def slow_links(field):
    """As `links`, pair by pair, and all edges looked at."""
    out = np.full((len(field.xy), 4), -1)
    usable = np.flatnonzero(field.strong & field.refined & (field.polarity != 0))
    i, j, length, angle = near_pairs(field.xy, usable, graph.NEIGHBOURS)
    (one, turn_i), (other, turn_j) = field.side_colour(i, angle), field.side_colour(j, angle)
    limit = np.where(length < graph.SMALL, graph.TOLERANCE_SMALL, graph.TOLERANCE)
    shown = (edge_contrast(field.grey, field.xy[i], field.xy[j]) * one[:, None]).min(axis=1)
    weaker = np.minimum(field.contrast[i], field.contrast[j])
    fine = (turn_i < limit) & (turn_j < limit) & (one == -other) & (shown > graph.LEAST_CONTRAST * weaker)
    for k in np.lexsort((j, -length)).tolist():
        if fine[k]:
            out[i[k], slot_of(field.axes[i[[k]]], angle[[k]])[0]] = j[k]
    back = [[b >= 0 and a in out[b] for b in row] for a, row in enumerate(out)]
    return np.where(back, out, -1)


@pytest.mark.parametrize(("seed", "spread"), [(0, 25.0), (1, 8.0), (2, 14.0)])
def test_links_are_those_of_all_pairs(seed, spread):
    field = crowd(seed, spread)
    found = links(field)
    assert (found >= 0).sum() > 300
    np.testing.assert_array_equal(found, slow_links(field))


def test_mutual_links_are_the_shortest_of_their_slots():
    rng = np.random.default_rng(4)
    i, j = rng.integers(0, 30, (2, 400))
    length, slot = rng.integers(1, 9, 400).astype(float), rng.integers(0, 6, 400)
    best = np.full((30, 6), -1)
    for k in np.lexsort((j, -length)).tolist():
        best[i[k], slot[k]] = j[k]
    expected = [[b if b >= 0 and a in best[b] else -1 for b in row] for a, row in enumerate(best.tolist())]
    np.testing.assert_array_equal(mutual(np.full((30, 6), -1), i, j, length, slot), expected)


def slow_cells(field, neighbour):
    """{corners}: all fours in which each is linked to the next, that turn clockwise and have sides of like lengths."""
    rows = [[n for n in row if n >= 0] for row in neighbour.tolist()]
    out = set()
    for a, row in enumerate(neighbour.tolist()):
        for k in range(4):
            b, d = row[k], row[(k + 1) % 4]
            for c in set(rows[b]) & set(rows[d]) - {a} if b >= 0 and d >= 0 else ():
                quad = field.xy[[a, b, c, d]]
                edge = np.roll(quad, -1, axis=0) - quad
                after, length = np.roll(edge, -1, axis=0), np.linalg.norm(edge, axis=1)
                like = all(0.4 < length[m] / length[m + 2] < 2.5 for m in (0, 1))
                if like and (edge[:, 0] * after[:, 1] > edge[:, 1] * after[:, 0]).all():
                    out.add(frozenset((a, b, c, d)))
    return out


@pytest.mark.parametrize("seed", range(4))
def test_cells_are_all_regular_fours(seed):
    """Also where links are chance."""
    field = crowd(seed)
    near = np.argsort(np.linalg.norm(field.xy[:, None] - field.xy, axis=2), axis=1)[:, 1:9]
    chance = np.random.default_rng(seed).permuted(near, axis=1)[:, :4]
    for neighbour in (links(field), np.ascontiguousarray(chance)):
        found = cells(field, neighbour).tolist()
        assert len(found) > 10
        assert len(found) == len({frozenset(quad) for quad in found})
        assert {frozenset(quad) for quad in found} == slow_cells(field, neighbour)


def slow_label(field, quads):
    """As `label`, cell by cell from a list of all that share an edge with the grid."""
    quads = [tuple(quad) for quad in quads.tolist()]
    score = [-field.response[list(quad)].min() for quad in quads]
    edges = [{frozenset((quad[k], quad[k - 1])) for k in range(4)} for quad in quads]
    left, grids = sorted(range(len(quads)), key=lambda q: (score[q], q)), []
    while left:
        at, where, heap = {}, {}, [(score[left[0]], left.pop(0))]
        while heap:
            n = heapq.heappop(heap)[1]
            spots = ((0, 0), (1, 0), (1, 1), (0, 1)) if not at else continued(where, quads[n])
            if not spots or any(
                at.get(s, c) != c or where.get(c, s) != s for c, s in zip(quads[n], spots, strict=True)
            ):
                continue
            at |= dict(zip(spots, quads[n], strict=True))
            where |= dict(zip(quads[n], spots, strict=True))
            for other in [m for m in left if edges[m] & edges[n]]:
                left.remove(other)
                heapq.heappush(heap, (score[other], other))
        grids.append(at)
    return grids


def continued(where, quad):
    """Labels of a cell from the first of its edges that is labelled."""
    for k in range(4):
        a, b = quad[k], quad[(k + 1) % 4]
        if a in where and b in where:
            u, v = where[a]
            du, dv = where[b][0] - u, where[b][1] - v
            spots = [(u, v), (u + du, v + dv), (u + du - dv, v + dv + du), (u - dv, v + du)]
            return [spots[(n - k) % 4] for n in range(4)] if abs(du) + abs(dv) == 1 else None
    return None


@pytest.mark.parametrize("seed", range(4))
def test_labels_are_those_of_the_slow_flood_fill(seed):
    field = crowd(seed)
    near = np.argsort(np.linalg.norm(field.xy[:, None] - field.xy, axis=2), axis=1)[:, 1:6]
    chance = np.random.default_rng(seed).permuted(near, axis=1)[:, :4]
    for neighbour in (links(field), np.ascontiguousarray(chance)):
        quads = np.random.default_rng(seed).permutation(cells(field, neighbour))
        grids = label(field, quads)
        assert [list(g.items()) for g in grids] == [list(g.items()) for g in slow_label(field, quads)]
        assert len(grids) > 1
