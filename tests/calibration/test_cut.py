"""Boards that are complete in themselves but cut by the picture's border."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.geometry import project, rotation
from rcdn.geometry.cut import cut_sides, cut_text, may_be_cut, whole_size
from rcdn.terminal.camera_text import cut_lines
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, labels, random_boards

BROWN = CAMERAS["brown"]
MIDDLE = np.array([0.12, 0.075, 0])


def seen(at, turn=0.0):
    """What a frame leaves of a board in rows and columns, its middle at `at` m, by a margin of 5 px."""
    ij = labels()
    R = rotation(np.array([0, 0, turn]))
    xy = project(BROWN, (np.column_stack([ij * SPACING, np.zeros(len(ij))]) - MIDDLE) @ R.T + at)
    inside = (xy > 5).all(axis=1) & (xy < np.array([634, 474])).all(axis=1)
    for axis in (0, 1):  # only whole rows and columns
        keep = [k for k in range(SIZE[axis]) if inside[ij[:, axis] == k].sum() >= 0.6 * inside.sum() ** 0.5]
        inside &= np.isin(ij[:, axis], keep)
    ij, xy = ij[inside], xy[inside]
    return board(ij - ij.min(axis=0), xy, (640, 480))


@pytest.mark.parametrize(
    ("at", "side"),
    [
        ((-0.24, 0, 0.42), "left"),
        ((0.22, 0, 0.42), "right"),
        ((0, -0.16, 0.42), "upper"),
        ((0, 0.18, 0.42), "lower"),
    ],
)
@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi])
def test_the_border_that_cuts_is_named(at, side, turn):
    part = seen(np.array(at), turn)
    assert part.complete
    assert part.size not in (SIZE, SIZE[::-1])
    assert cut_sides(part.ij, part.xy, part.image_size) == (side,)
    cols, rows = part.size
    assert cut_text(part.ij, part.xy, part.image_size, SIZE) == f"{cols}×{rows} seen, cut by the {side} border"
    assert may_be_cut(part)


def test_whole_boards_in_view_are_not_cut():
    for part in random_boards(BROWN, 1, 30, whole=True, spread=0.25)[0]:
        assert not cut_text(part.ij, part.xy, part.image_size, SIZE)
    middle = seen(np.array([0, 0, 0.6]))
    assert middle.size == SIZE
    assert cut_sides(middle.ij, middle.xy, middle.image_size) == ()


def test_a_smaller_board_in_the_middle_is_not_cut():
    middle = seen(np.array([0, 0, 0.6]))
    keep = middle.ij[:, 0] < 7
    assert not may_be_cut(board(middle.ij[keep], middle.xy[keep], (640, 480)))


def test_grids_with_holes_and_triangles_are_not_judged():
    part = seen(np.array([-0.24, 0, 0.42]))
    holed = board(part.ij[1:], part.xy[1:], (640, 480))
    assert not may_be_cut(holed)
    assert not may_be_cut(replace(part, pattern="deltille"))
    assert not may_be_cut(board(np.zeros((0, 2), int), np.zeros((0, 2)), (640, 480)))


def test_cut_boards_do_not_settle_the_size():
    cut = [seen(np.array([x, 0, 0.42])) for x in (-0.24, -0.24, 0.22)]
    whole = random_boards(BROWN, 2, 2, whole=True, spread=0.2)[0]
    assert whole_size([*cut, *whole]) == SIZE
    assert whole_size(cut[:2]) == cut[0].size  # always the same: nothing speaks against it
    lower = seen(np.array([0, 0.18, 0.42]))
    assert whole_size([cut[0], lower]) is None
    assert whole_size([]) is None


def test_a_calibration_names_them():
    whole = random_boards(BROWN, 3, 5, whole=True, spread=0.3)[0]
    cut = [seen(np.array([-0.24, 0.01 * k, 0.42])) for k in range(6)]
    names = [*(f"whole{k}.png" for k in range(5)), *(f"cut{k}.png" for k in range(6))]
    done = calibrate([*whole, *cut], SPACING, names=names, model="brown")
    assert done.size == SIZE
    assert [v.settled for v in done.views] == [True] * 5 + [False] * 6
    lines = cut_lines(done)
    assert lines
    assert all("cut by the left border, of 9×6: cut" in line for line in lines)
