"""Corners beyond a board's rim, where a dark background meets its white margin as a square would."""

import cv2
import numpy as np
import pytest
from board_scene import View, board, scene, view

from rcdn import Detector
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.boards.rim import cut_at_rim
from rcdn.synthetic import Cover

COLS, ROWS = 7, 5
SIDES = ("left", "top", "right", "bottom")


def place(side, k):
    """The k-th square of the ring on one side."""
    return {"left": (0, k), "right": (COLS + 2, k), "top": (k, 0), "bottom": (k, ROWS + 2)}[side]


def patches(side, count):
    """Dark squares beyond one side that make so many corners there: a square at both of its
    ends, two in a row at one."""
    k = next(k for k in (3, 4) if sum(place(side, k)) % 2 == 0)
    return {place(side, k)} | ({place(side, k - 1)} if count == 1 else set())


def ringed(dark, margin=0.0, **settings):
    """A board of 7 × 5 corners, (1, 1) the first, in a white ring of one square but for the squares `dark`."""
    squares = [(i, j) for i in range(COLS + 3) for j in range(ROWS + 3)]
    ring = [(i, j) for i, j in squares if i in (0, COLS + 2) or j in (0, ROWS + 2)]
    painted = tuple((i, j, 0.05 if (i, j) in dark else 0.9) for i, j in ring)
    return board(COLS + 2, ROWS + 2, painted=painted, margin=margin, **settings)


def is_whole(found):
    """Is the only board the whole one, and no more?"""
    return len(found) == 1 and found[0].complete and found[0].size in ((COLS, ROWS), (ROWS, COLS))


@pytest.mark.parametrize("margin", [0.0, 1.0])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("side", SIDES)
def test_corners_in_the_margin_are_no_column(side, count, margin):
    turn = 10 + 50 * SIDES.index(side) + 13 * count
    spec = ringed(patches(side, count), margin, pitch=27.0, roll=turn, tilt=25.0 * margin)
    shown = View(scene(boards=(spec,), noise=3.0))
    assert is_whole(Detector().boards(shown.grey))


def cut_grid(shown, keep):
    """The Grid of a view's corners for which `keep(i, j)`, after the cut at its rim,
    and whether it says that it dropped any."""
    field, number = shown.field()
    at = {tuple(shown.ij[n].tolist()): k for k, n in enumerate(number) if n >= 0 and keep(*shown.ij[n])}
    grid, free = Grid(at, field.xy), np.ones(len(field.xy), bool)
    free[list(at.values())] = False
    dropped = cut_at_rim(field, grid, board_sign(field, grid), free)
    assert free.sum() == len(free) - len(grid)
    return grid, dropped


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_column_whose_other_corners_are_to_be_seen_stays(rows):
    """However few of them were detected: the picture speaks for the column."""
    shown = view("flat")
    grid, dropped = cut_grid(shown, lambda i, j: i < 6 or j < rows)
    assert not dropped
    assert len(grid) == 30 + rows


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_column_behind_a_cover_stays(rows):
    """A hand, or a sheet of paper, over the rest of the last column: it hides the edges that lead to what it hides."""
    flat = view("flat")
    low, high = flat.xy[flat.index(6, rows)], flat.xy[flat.index(6, 4)]
    for value in (0.05, 0.9):
        cover = Cover(*low, high[0], high[1] + 20.0, 22.0, value, True)
        shown = View(scene(tilt=0.0, roll=0.0, noise=0.0, covers=(cover,)))
        grid, dropped = cut_grid(shown, lambda i, j: True)
        assert not dropped
        assert (6, 0) in grid.at
        (found,) = Detector().boards(shown.grey)
        assert found.size == (7, 5)


@pytest.mark.parametrize("roll", [4.0, 8.0, 14.0])
def test_a_column_that_the_frame_cuts_stays(roll):
    """Few corners of the last column are within the frame, the fewer the steeper it runs."""
    whole = View(scene(tilt=0.0, roll=roll, pitch=30.0))
    last = np.sort(whole.xy[whole.ij[:, 0] == 6][:, 0])
    grey = np.ascontiguousarray(whole.grey[:, : int(last[-2]) + 6])
    inside = whole.xy[:, 0] < grey.shape[1] - 5
    (found,) = Detector().boards(grey)
    assert found.size == (7, 5)
    assert len(found) >= inside.sum()


def test_a_room_with_boards_before_a_bright_pole(shared_data):
    """Lightened, the picture had one of its twelve boards as 8 × 5, with one corner of 5 in the first column."""
    grey = cv2.imread(str(shared_data / "libcbdetect-mixed" / "example_data__e5.png"), cv2.IMREAD_GRAYSCALE)
    light = (255 * (grey / 255.0) ** 0.4).astype(np.uint8)
    found = Detector().boards(light)
    assert {(5, 7), (7, 5), (11, 7), (5, 15)} == {b.size for b in found if len(b) > 34}
    assert all(b.complete for b in found if len(b) > 34)
