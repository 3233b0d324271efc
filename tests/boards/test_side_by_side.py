"""Boards with a strip of paper between them, whose squares alternate across it, become two; one board stays one,
however it is bent, folded, tilted, printed or seen."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rcdn
from rcdn.boards.local import Grid
from rcdn.boards.side_by_side import apart
from rcdn.types import Camera

COLS, ROWS = 9, 6
F = 700.0


def labels(cols=2 * COLS + 1, rows=ROWS):
    return np.array([(u, v) for v in range(rows) for u in range(cols)])


def along(spots, gap):
    """(N,) places along the rows of two boards, `gap` squares apart, and of the line in the middle of the gap."""
    u = spots[:, 0].astype(float)
    return u + gap * (u > COLS) + gap / 2 * (u == COLS)


def seen(points, turn=(0.2, 0.3, 0.1), distance=24.0, camera=None):
    """Positions of points (N, 3), squares, through a pinhole or a given camera, tilted by a rotation vector."""
    R, _ = cv2.Rodrigues(np.array(turn, float))
    there = (points - points.mean(axis=0)) @ R.T + [0, 0, distance]
    if camera is not None:
        return camera.project(there)
    return F * there[:, :2] / there[:, 2:] + (320, 240)


def flat(x, y):
    return np.column_stack([x, y, np.zeros(len(x))])


def grid_of(spots, xy, seed=0, noise=0.1):
    rng = np.random.default_rng(seed)
    return Grid({tuple(spot): k for k, spot in enumerate(spots.tolist())}, xy + rng.normal(0, noise, xy.shape))


turns = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-3, 3))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.floats(0.12, 0.45), turns, st.booleans(), st.integers(0, 99))
def test_two_boards_with_a_gap_become_two_without_the_line_between(gap, turn, swapped, seed):
    spots = labels()
    xy = seen(flat(along(spots, gap), spots[:, 1]), turn)
    if swapped:  # the gap between rows
        spots = spots[:, ::-1] * [1, -1]
    found = apart(grid_of(spots, xy, seed))
    at = 1 if swapped else 0
    lines = sorted(sorted({abs(spot[at]) for spot in part.at}) for part in found)
    assert lines == [list(range(COLS)), list(range(COLS + 1, 2 * COLS + 1))]
    assert all(len(part) == COLS * ROWS for part in found)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(turns, st.integers(0, 99))
def test_one_board_stays_one(turn, seed):
    spots = labels()
    assert len(apart(grid_of(spots, seen(flat(spots[:, 0].astype(float), spots[:, 1]), turn), seed))) == 1


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.floats(0, 1.2), st.floats(4, 14), st.integers(0, 99))
def test_a_folded_board_stays_one(angle, fold, seed):
    """Folded along any line between or through its corners."""
    spots = labels()
    beyond = np.maximum(spots[:, 0] - fold, 0)
    points = np.column_stack([spots[:, 0] - beyond * (1 - np.cos(angle)), spots[:, 1], -beyond * np.sin(angle)])
    assert len(apart(grid_of(spots, seen(points), seed))) == 1


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(2.5, 30), turns, st.integers(0, 99))
def test_a_board_on_a_cylinder_stays_one(radius, turn, seed):
    spots = labels(12)
    angle = (spots[:, 0] - 5.5) / radius * min(1.0, radius / 5)
    points = np.column_stack([radius * np.sin(angle), spots[:, 1], radius * (1 - np.cos(angle))])
    assert len(apart(grid_of(spots, seen(points, turn), seed))) == 1


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(-3, 3)), st.floats(3, 9), st.integers(0, 99))
def test_a_board_close_to_a_fisheye_stays_one(turn, distance, seed):
    """Steps in the middle of such a picture are several times those at its rim."""
    camera = Camera(np.array([[250.0, 0, 320], [0, 250, 240], [0, 0, 1]]), [0.02, -0.01, 0, 0], (640, 480), "fisheye")
    spots = labels(9, 7)
    xy = seen(flat(spots[:, 0].astype(float), spots[:, 1]), turn, distance, camera)
    known = np.isfinite(xy).all(axis=1)
    assert len(apart(grid_of(spots[known], xy[known], seed))) == 1


@pytest.mark.parametrize("seam", [0.1, -0.1, 0.3])
def test_a_board_of_two_sheets_stays_one(seam):
    """The seam lies within a square: one step is longer or shorter."""
    spots = labels()
    x = spots[:, 0] + seam * (spots[:, 0] > COLS)
    assert len(apart(grid_of(spots, seen(flat(x, spots[:, 1]))))) == 1


def test_uneven_prints_stay_one():
    """Lines off their places by .05 squares all over the board."""
    rng, spots = np.random.default_rng(1), labels()
    for _ in range(100):
        x = (np.arange(2 * COLS + 1) + rng.normal(0, 0.05, 2 * COLS + 1))[spots[:, 0]]
        assert len(apart(grid_of(spots, seen(flat(x, spots[:, 1]))))) == 1


@pytest.mark.parametrize("gap", [0.15, 0.3])
def test_both_are_found_whole_in_a_picture(gap):
    side, strip = 40, round(40 * gap)
    squares = 40 + 170 * (np.indices((ROWS + 1, COLS + 1)).sum(0) % 2)
    board = np.kron(squares, np.ones((side, side)))
    sheet = np.pad(np.hstack([board, np.full((len(board), strip), 210.0), board]), 60, constant_values=210)
    picture = np.uint8(np.clip(cv2.GaussianBlur(sheet, (0, 0), 0.8), 0, 255))
    found = rcdn.Detector().detect(picture).boards
    assert [b.size for b in found] == [(COLS, ROWS)] * 2
    assert all(b.complete for b in found)
    first = 60 + side - 0.5
    for b, at in zip(sorted(found, key=lambda b: b.xy[:, 0].mean()), (0, (COLS + 1) * side + strip), strict=True):
        assert b.xy.min(axis=0) == pytest.approx([first + at, first], abs=0.1)
