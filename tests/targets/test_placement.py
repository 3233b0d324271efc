"""Markers are looked for where they really are: off the middles of their squares by parts of a dot,
as programs draw them on a raster."""

import numpy as np
import pytest
from coded_scene import SQUARE, charuco, seen

from rcdn import Detector, DetectorConfig
from rcdn.targets.placement import placement

DETECTOR = Detector(DetectorConfig(target="auto"))


def misprinted(columns, rows, by, ratio=0.75):
    """A drawing whose markers in column c, row r are off by `by(c, r)` (x, y) dots."""
    drawing = charuco(columns, rows, "DICT_4X4_50", ratio=ratio)
    gap = round(SQUARE * (1 - ratio) / 2)
    first = np.round(drawing.xy[0] + 0.5).astype(int) - SQUARE
    for row in range(rows):
        for column in range(columns):
            if (column + row) % 2:
                x, y = first + SQUARE * np.array([column, row])
                inside = drawing.image[y + 1 : y + SQUARE - 1, x + 1 : x + SQUARE - 1]
                assert gap > 2
                inside[:] = np.roll(inside, by(column, row)[::-1], axis=(0, 1))
    return drawing


@pytest.mark.parametrize("by", [lambda c, r: (0, 0), lambda c, r: (1, -1), lambda c, r: (c % 3 - 1, 1 - r % 3)])
@pytest.mark.parametrize("turn", [0.2, 2.0])
def test_where_markers_stand_is_measured(by, turn):
    image, xy = seen(misprinted(7, 6, by), noise=2, turn=turn, seed=3)
    (board,) = DETECTOR.boards(image)
    placed = placement(image, board, board.target)
    column, row = np.meshgrid(np.arange(1, 6), np.arange(1, 5))
    wanted = np.array([[by(*at) for at in zip(*line, strict=True)] for line in zip(column, row, strict=True)])
    assert np.abs(placed.shift(column, row) - wanted / SQUARE).max() < 0.004
    assert placed.side == pytest.approx(0.75, abs=0.003)
    off = board.xy - xy[board.ids]
    assert np.sqrt(np.square(off).mean()) < 0.012


def test_markers_that_stand_elsewhere_have_no_place():
    """A twenty-fourth of a square is no rounding: nobody knows what is printed there,
    and corners are fitted as those of plain boards."""
    image, xy = seen(misprinted(7, 6, lambda c, r: (4, 0)), noise=1)
    (board,) = DETECTOR.boards(image)
    assert placement(image, board, board.target) is None
    assert np.abs(board.xy - xy[board.ids]).max() < 0.1
