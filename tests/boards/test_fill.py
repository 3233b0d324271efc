"""Corners found in the picture alone where a board predicts them, and corners that hang on by one edge."""

import numpy as np
import pytest
from board_scene import VIEWS, View, clutter, scene, view

from rcdn.boards.edges import crossings
from rcdn.boards.fill import fill
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.synthetic import Cover, Light
from rcdn.types import Status


def whole(shown, without=(), **changes):
    """Field and Grid of all corners of a view's only board, but those `without`."""
    field, number = shown.field(without=without, **changes)
    return field, Grid({tuple(shown.ij[n].tolist()): k for k, n in enumerate(number) if n >= 0}, field.xy)


def unused(field, grid):
    free = np.ones(len(field.xy), bool)
    free[list(grid.at.values())] = False
    return free


def shaded(value, angle, soft=0.5, at=(240.0, 180.0)):
    """A flat board with the edge of a shadow through `at`, of `value` of the light."""
    c, s = np.cos(angle), np.sin(angle)
    far = 900.0
    x, y = at[0] - s * far, at[1] + c * far
    shadow = Cover(x - c * far, y - s * far, x + c * far, y + s * far, far, value, True, soft)
    return View(scene(tilt=15.0, light=Light(shadows=(shadow,))))


@pytest.mark.parametrize("name", VIEWS)
def test_a_crossing_is_measured_from_a_wrong_prediction(name):
    """Offsets put into the prediction come out again; both edges are seen."""
    shown = view(name)
    field, grid = whole(shown)
    sign = board_sign(field, grid)
    spots = sorted(grid.at)
    spots = [s for s, support in zip(spots, grid.predictions(spots).support, strict=True) if support >= 8]
    guess = grid.predictions(spots)
    du, dv = guess.du, guess.dv
    put = np.random.default_rng(3).uniform(-0.12, 0.12, (len(spots), 2))
    true = np.array([shown.xy[shown.number(grid.xy[[grid.at[s]]])[0]] for s in spots])
    start = true - put[:, :1] * du - put[:, 1:] * dv
    colour = np.array([sign * (-1) ** sum(s) for s in spots])
    offset, strength = crossings(shown.grey, start, du, dv, colour)
    assert (strength > 0).all()
    assert np.abs(offset - put).max() < (0.055 if name == "small" else 0.035)
    assert (crossings(shown.grey, start, du, dv, -colour)[1] < 0.3 * strength).all()


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.1, 1.9])
@pytest.mark.parametrize("value", [0.25, 0.5])
def test_corners_under_a_shadows_edge_are_filled_in(value, angle):
    """Candidates within 6 px of the edge are missing; but for the rim's, the board has them all the
    same, at their places."""
    shown = shaded(value, angle)
    normal = np.array([-np.sin(angle), np.cos(angle)])
    inside = (shown.ij > 0).all(axis=1) & (shown.ij < shown.ij.max(axis=0)).all(axis=1)
    lost = np.flatnonzero((np.abs((shown.xy - [240, 180]) @ normal) < 6) & inside)
    assert len(lost) >= 1
    (board,) = shown.found(without=lost)
    assert len(board) == len(shown)
    assert shown.wrong(board) == 0
    filled = board.response == 0
    assert filled.sum() >= len(lost)
    assert (board.status[filled] == Status.COMPLETED).all()
    error = np.linalg.norm(board.xy - shown.xy[shown.number(board.xy)], axis=1)
    assert error[filled].max() < 1.5


@pytest.mark.parametrize("square", [True, False])
@pytest.mark.parametrize("value", [0.1, 0.5, 0.9])
def test_a_covered_corner_is_never_filled_in(value, square):
    flat = view("flat")
    hidden = [flat.index(3, 2), flat.index(5, 1)]
    covers = tuple(Cover(*(flat.xy[n] - [9.0, 2.0]), *(flat.xy[n] + [9.0, 2.0]), 9.0, value, square) for n in hidden)
    shown = View(scene(tilt=0.0, roll=0.0, noise=0.0, covers=covers))
    assert len(shown) == len(flat) - 2
    (board,) = shown.found()
    assert shown.wrong(board) == 0
    assert len(board) == len(shown)


@pytest.mark.parametrize("name", VIEWS)
def test_nothing_is_added_to_a_whole_board(name):
    shown = view(name)
    field, grid = whole(shown)
    before = dict(grid.at)
    fill(field, grid, board_sign(field, grid), unused(field, grid))
    assert grid.at == before


@pytest.mark.parametrize("name", VIEWS)
def test_lost_corners_come_back_with_their_own_labels(name):
    shown = view(name)
    rng = np.random.default_rng(5)
    inside = (shown.ij > 0).all(axis=1) & (shown.ij < shown.ij.max(axis=0)).all(axis=1)
    lost = rng.choice(np.flatnonzero(inside), len(shown) // 8, replace=False)
    field, grid = whole(shown, without=lost, extra=clutter(shown, 20, 1, apart=10))
    before = dict(grid.at)
    fill(field, grid, board_sign(field, grid), unused(field, grid))
    assert before.items() <= grid.at.items()
    for spot, corner in grid.at.items():
        n = shown.number(grid.xy[[corner]])[0]
        assert n >= 0
        assert tuple(shown.ij[n].tolist()) == spot
    assert len(grid) == len(shown)


def test_beyond_its_rim_a_board_takes_nothing_that_the_network_did_not_answer():
    shown = view("flat")
    rim = [shown.index(6, v) for v in range(5)]
    field, grid = whole(shown, without=rim)
    fill(field, grid, board_sign(field, grid), unused(field, grid))
    assert len(grid) == len(shown) - 5


def test_without_colours_nothing_is_filled():
    shown = view("flat")
    field, grid = whole(shown, without=[shown.index(3, 2)])
    count = len(grid)
    fill(field, grid, 0, unused(field, grid))
    assert len(grid) == count


def test_a_corner_hangs_on_by_one_edge():
    """The corner (6, 0) keeps its neighbour (5, 0), but no cell."""
    shown = view("flat")
    lone, gone = shown.index(6, 0), [shown.index(6, v) for v in range(1, 5)]
    (board,) = shown.found(without=gone)
    assert lone in shown.number(board.xy)
    assert shown.wrong(board) == 0
