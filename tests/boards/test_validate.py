"""Drop-only validation."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from board_scene import view
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards.edges import edge_sharpness
from rcdn.boards.graph import Field
from rcdn.boards.local import Grid, cell_count
from rcdn.boards.validate import believable, distinct, has_rims, plain, predicted_excess, prune
from rcdn.geometry.rules import CHECKER

COLS, ROWS, PITCH = 7, 5, 20.0


def lattice(cols=COLS, rows=ROWS, pitch=PITCH, spots=None):
    """A perfect grid and its field; corner (u, v) has the number u + v · cols."""
    ij = np.array([(u, v) for v in range(rows) for u in range(cols)], float)
    xy = ij @ [[pitch, 0.1 * pitch], [-0.1 * pitch, pitch]] + 40
    one = np.ones(len(xy))
    field = Field(
        np.zeros((9, 9)), xy, np.zeros((len(xy), 2)), one, one.copy(), one.copy(), one.copy(), one > 0, one > 0
    )
    every = {(u, v): u + v * cols for v in range(rows) for u in range(cols)}
    return field, Grid({s: every[s] for s in (every if spots is None else spots)}, xy)


def test_nothing_is_dropped_from_a_perfect_grid():
    field, grid = lattice()
    prune(grid, field)
    assert len(grid) == COLS * ROWS


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(0, 0.6), st.floats(0.2, 1), st.booleans())
def test_prune_never_adds_or_renames(seed, scatter, share, poor):
    rng = np.random.default_rng(seed)
    field, grid = lattice()
    grid.xy += rng.normal(0, scatter * PITCH, grid.xy.shape)
    if poor:
        field.response[:] = rng.uniform(0, 1, len(field.xy))
    grid = Grid({s: k for s, k in grid.at.items() if rng.random() < share}, grid.xy)
    before = dict(grid.at)
    prune(grid, field)
    assert grid.at.items() <= before.items()
    held = {(u + d, v + e) for u, v in grid.at for d in (0, 1) for e in (0, 1)
            if all((u + a, v + b) in grid.at for a in (0, 1) for b in (0, 1))}  # fmt: skip
    assert set(grid.at) == held


@pytest.mark.parametrize("spot", [(0, 0), (3, 0), (0, 2), (3, 2), (5, 3), (6, 4)])
@pytest.mark.parametrize("angle", [0.3, 2.0, 4.4])
def test_one_displaced_corner_goes_and_no_other(spot, angle):
    """But for what then belongs to no whole cell, which is so beside the board's corners."""
    field, grid = lattice()
    grid.xy[grid.at[spot]] += 0.45 * PITCH * np.array([np.cos(angle), np.sin(angle)])
    prune(grid, field)
    assert spot not in grid.at
    assert len(grid) == COLS * ROWS - (4 if spot == (5, 3) else 1)


def test_a_small_displacement_is_no_reason():
    field, grid = lattice()
    grid.xy[grid.at[3, 2]] += [0.1 * PITCH, 0]
    prune(grid, field)
    assert len(grid) == COLS * ROWS


def test_a_displaced_corner_of_a_picture_goes_and_the_true_one_takes_its_place():
    """0.25 squares off, where the graph still links it and completion would still take it."""
    shown = view("flat")
    moved = shown.index(3, 2)
    (found,) = shown.found(moved={moved: (5.3, 5.3)})
    assert found.complete
    assert found.size == (7, 5)
    assert shown.wrong(found) == 0
    (again,) = np.flatnonzero(shown.number(found.xy) == moved)
    assert np.linalg.norm(found.xy[again] - shown.xy[moved]) < 0.5


@pytest.mark.parametrize(("spot", "stays"), [((3, 0), False), ((0, 0), False), ((3, 2), True)])
@pytest.mark.parametrize("how", ["response", "fit"])
def test_rim_corners_need_looks_of_their_own(spot, stays, how):
    field, grid = lattice()
    getattr(field, how)[grid.at[spot]] = 0.2
    prune(grid, field)
    assert (spot in grid.at) == stays
    assert len(grid) == COLS * ROWS - (not stays)


def test_a_poor_line_on_the_rim_goes_whole():
    field, grid = lattice()
    field.fit[[grid.at[u, 0] for u in range(COLS)]] = 0.2
    prune(grid, field)
    assert {v for _, v in grid.at} == {1, 2, 3, 4}
    assert len(grid) == COLS * (ROWS - 1)


def test_a_shadow_is_no_reason():
    """Contrast alone counts for at most 0.45: corners in a shadow are corners."""
    field, grid = lattice()
    field.contrast[[grid.at[0, v] for v in range(ROWS)]] = 0.1
    prune(grid, field)
    assert len(grid) == COLS * ROWS


def test_corners_outside_whole_cells_go():
    square = [(u, v) for v in range(3) for u in range(3)]
    field, grid = lattice(spots=[*square, (3, 1), (4, 1)])
    prune(grid, field)
    assert sorted(grid.at) == sorted(square)


def test_parts_that_no_edge_joins_are_handed_back():
    """Something thin may lie across a board, or two boards may touch: which it is, is not for the validation to say."""
    large = [(u, v) for v in range(5) for u in range(3)]
    small = [(u, v) for v in range(4) for u in (4, 5)]
    field, grid = lattice(spots=large + small)
    others = prune(grid, field)
    assert sorted(grid.at) == sorted(large)
    assert [sorted(part.at) for part in others] == [sorted(small)]


@pytest.mark.parametrize("seed", range(20))
def test_what_is_left_fits(seed):
    """A second pass finds nothing more to drop."""
    rng = np.random.default_rng(seed)
    field, grid = lattice()
    field.xy[:] += rng.normal(0, 0.125, field.xy.shape) * np.linalg.norm(
        field.xy[grid.at[1, 0]] - field.xy[grid.at[0, 0]]
    )
    prune(grid, field)
    left = dict(grid.at)
    prune(grid, field)
    assert grid.at == left


def dropped_by_rule(grid, field):
    """What `prune` leaves, spelled out: {label: corner}."""
    at, before = dict(grid.at), -1
    step = range(-2, 3)
    while before != len(at):
        before = len(at)
        while at:
            spots = sorted(at)
            excess = predicted_excess(Grid(at, grid.xy), spots)
            worst = int(excess.argmax())
            if excess[worst] <= 1:
                break
            del at[spots[worst]]
        while at:
            quality = {s: field.response[c] * field.fit[c] for s, c in at.items()}
            typical, poor = max(np.median(list(quality.values())), 1e-9), []
            for u, v in at:
                ways = [[(u + d * k, v + e * k) in at for k in (1, 2, 3)] for d, e in CHECKER.steps]
                near = [field.contrast[at[s]] for d in step for e in step if (d or e) and (s := (u + d, v + e)) in at]
                share = np.clip(field.contrast[at[u, v]] / max(np.median(near), 1e-9), 0.45, 1) if near else 1
                if not all(map(any, ways)) and quality[u, v] / typical * share < 0.3:
                    poor.append((u, v))
            if not poor:
                break
            at = {s: c for s, c in at.items() if s not in poor}
        whole = [(u, v) for u, v in at if all((u + a, v + b) in at for a in (0, 1) for b in (0, 1))]
        held = {(u + a, v + b) for u, v in whole for a in (0, 1) for b in (0, 1)}
        at = {s: c for s, c in at.items() if s in held}
    return at


@pytest.mark.parametrize("seed", range(40))
def test_prune_does_what_it_says(seed):
    """Rough lattices with gaps and poor corners; what falls off in parts counts, too."""
    rng = np.random.default_rng(seed)
    field, grid = lattice(9, 7)
    field.xy[:] += rng.normal(0, rng.choice([0.02, 0.08, 0.15]) * PITCH, field.xy.shape)
    for column in (field.response, field.fit, field.contrast):
        column[:] = rng.uniform(rng.choice([0.2, 0.7]), 1, len(column))
    shift = rng.integers(-50, 50, 2)
    kept = [(s, k) for s, k in grid.at.items() if rng.random() < 0.9]
    grid = Grid({(s[0] + int(shift[0]), s[1] + int(shift[1])): k for s, k in kept}, grid.xy)
    expected = dropped_by_rule(grid, field)
    order = list(grid.at)
    rest = prune(grid, field)
    assert all(len(a) >= len(b) for a, b in pairwise([grid, *rest]))
    assert grid.at | {s: c for part in rest for s, c in part.at.items()} == expected
    assert len(grid) + sum(map(len, rest)) == len(expected)
    assert list(grid.at) == [s for s in order if s in grid.at]


def test_excess_is_the_distance_from_the_prediction():
    """A corner off by a fifth of a square: 0.15 of one is allowed between neighbours, 0.18 at a corner of the grid."""
    for spot, limit in (((3, 2), 0.15), ((3, 0), 0.15), ((0, 0), 0.18)):
        field, grid = lattice()
        field.xy[grid.at[spot]] += [0, 0.2 * PITCH]
        steps = np.hypot(PITCH, 0.1 * PITCH)
        assert predicted_excess(grid, [spot])[0] == pytest.approx(0.2 * PITCH / (limit * steps))
    _, alone = lattice(spots=[(0, 0), (1, 0)])
    assert predicted_excess(alone, [(0, 0), (1, 0)]).tolist() == [2, 2]
    assert predicted_excess(alone, []).shape == (0,)


def test_an_empty_grid():
    field, grid = lattice(spots=[])
    prune(grid, field)
    assert len(grid) == 0
    assert not believable(grid, 1)


@pytest.mark.parametrize(
    ("size", "pitch", "least", "answer"),
    [
        ((3, 3), 20, 9, True),
        ((3, 3), 20, 10, False),
        ((2, 5), 20, 9, True),
        ((2, 4), 20, 4, False),  # three cells
        ((4, 4), 5, 9, False),  # keyboards look like this
        ((4, 5), 5, 9, True),
        ((9, 6), 5, 9, True),
    ],
)
def test_believable(size, pitch, least, answer):
    assert believable(lattice(*size, pitch)[1], least) == answer


@pytest.mark.parametrize(
    ("pitch", "missing", "answer"),
    [(6.5, 1, True), (6.5, 9, False), (5.2, 0, True), (5.2, 1, False), (4.5, 0, True), (4.5, 1, False), (7.5, 9, True)],
)
def test_small_squares_must_fill_their_box(pitch, missing, answer):
    """Keyboards look like boards of 5 px squares, but seldom like whole ones."""
    whole = sorted(lattice(9, 6)[1].at)
    spots = [spot for n, spot in enumerate(whole) if n not in range(7, 7 + 5 * missing, 5)]
    assert believable(lattice(9, 6, pitch, spots=spots)[1], 9) == answer


def test_cell_count():
    assert cell_count(lattice()[1]) == (COLS - 1) * (ROWS - 1)
    assert cell_count(lattice(spots=[(0, 0), (1, 0), (0, 1)])[1]) == 0


@pytest.mark.parametrize(("shape", "low", "high"), [("step", 0.9, 1.05), ("ramp", 0.28, 0.38), ("sine", 0.33, 0.43)])
def test_sharpness_of_known_profiles(shape, low, high):
    """Links of 20 px down the middle of an edge that runs along y."""
    x = (np.arange(101) - 50.0) / 20
    profile = {"step": np.tanh(40 * x), "ramp": np.clip(x, -0.5, 0.5), "sine": np.sin(np.pi * x)}[shape]
    grey = np.tile(128 + 100 * profile, (101, 1)).astype(np.float32)
    start = np.array([[50.0, y] for y in (20, 40, 60)])
    assert low < edge_sharpness(grey, start, start + np.array([0.0, 20.0])) < high


@pytest.mark.parametrize(
    ("cols", "rows", "blur", "answer"), [(4, 4, 0.02, True), (4, 4, 0.4, False), (5, 5, 0.4, True), (3, 3, 0.02, True)]
)
def test_boards_of_soft_edges_must_be_larger(cols, rows, blur, answer):
    """A checkerboard of 20 px squares under a blur of that many squares."""
    _, grid = lattice(cols, rows)
    spots = np.linalg.inv([[PITCH, 0.1 * PITCH], [-0.1 * PITCH, PITCH]])
    y, x = np.mgrid[:200, :200]
    u, v = np.moveaxis(np.stack([x - 40, y - 40], axis=-1) @ spots, -1, 0)
    wave = np.sin(np.pi * u) * np.sin(np.pi * v)
    grey = (128 + 100 * np.tanh(wave / blur / 2 if blur < 0.1 else wave)).astype(np.float32)
    assert distinct(grid, grey) == answer


def test_narrow_rims_around_markers_are_sharp():
    """Foreshortened squares, the dark ones with white markers of .75: across their long sides, a tenth of the length is
    inside the marker."""
    width, height = 32, 56
    dark = np.indices((6, 6)).sum(axis=0) % 2 == 0
    grey = np.kron(np.where(dark, 20, 220), np.ones((height, width))).astype(np.float32)
    for row, column in zip(*np.nonzero(dark), strict=True):
        y, x = row * height, column * width
        grey[y + 7 : y + height - 7, x + 4 : x + width - 4] = 220
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    field, grid = lattice(3, 4)
    grid.xy[:] = field.xy[:] = np.array(list(grid.at)) * [width, height] + [2 * width - 0.5, 2 * height - 0.5]
    field.contrast[:] = 200
    field = replace(field, grey=grey)
    assert not distinct(grid, grey)
    assert has_rims(grid, field)


@pytest.mark.parametrize(
    ("pitch", "blur", "answer"), [(40, 0.02, True), (40, 0.4, False), (18, 0.4, False), (8, 0.4, False)]
)
def test_waves_have_no_rims(pitch, blur, answer):
    y, x = np.mgrid[:400, :400] - 40.0
    wave = np.sin(np.pi * x / pitch) * np.sin(np.pi * y / pitch)
    grey = (128 + 100 * np.tanh(wave / blur / 2 if blur < 0.1 else wave)).astype(np.float32)
    field, grid = lattice(4, 4)
    grid.xy[:] = field.xy[:] = np.array(list(grid.at)) * float(pitch) + 40
    field.contrast[:] = np.ptp(grey)
    assert has_rims(grid, replace(field, grey=grey)) == answer


@pytest.mark.parametrize(
    ("cols", "response", "typical", "answer"),
    [(7, 0.8, 0.8, True), (7, 0.4, 0.8, False), (7, 0.5, 0.6, True), (3, 0.5, 0.5, False), (3, 0.7, 0.8, True)],
)
def test_corners_of_a_board_answer_about_as_usual(cols, response, typical, answer):
    _, grid = lattice(cols)
    assert plain(grid, np.full(35, response), typical) == answer
