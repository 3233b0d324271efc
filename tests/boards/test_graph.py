"""Links, cells and labels on boards whose corners are known."""

import numpy as np
import pytest
from board_scene import VIEWS, View, board, scene, turn, view

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, cells, label, links


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


def test_edge_contrast_of_very_many_links():
    """OpenCV's remap takes fewer than 32768 rows and columns."""
    grey = np.zeros((40, 60), np.uint8)
    grey[20:] = 100
    start = np.tile([[10.0, 19.5]], (5000, 1))
    assert edge_contrast(grey, start, start + np.array([20, 0])).min() > 99
