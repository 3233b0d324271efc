"""The code of PuzzleBoards is that of its authors."""

import cv2
import numpy as np
import pytest

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.types import PuzzleBoard


def test_rows_are_in_the_order_of_the_board_generator():
    """It paints the edge from corner (x, y) to (x + 1, y) by row x % 3 of its second code, to (x, y + 1)
    by row y % 3 of the first one."""
    assert [row[:12] for row in CODE_1] == ["000010111000", "011000011111", "010000010100"]
    assert [row[:12] for row in CODE_2] == ["111110101001", "101100110001", "001100000101"]
    assert {len(row) for row in (*CODE_1, *CODE_2)} == {167}


def test_boards_that_another_program_prints_have_their_numbers():
    """calib-targets counts squares, not corners, and its origin lies 334 off in both directions."""
    other = pytest.importorskip("calib_targets")
    column, row = 7, 30
    printed = other.render_target_bundle(other.puzzleboard_document(14, 11, 14.0, origin_row=row, origin_col=column))
    page = cv2.imdecode(np.frombuffer(printed.png_bytes, np.uint8), cv2.IMREAD_GRAYSCALE)
    scale = 0.4
    (board,) = Detector(DetectorConfig(target="auto")).boards(
        cv2.resize(page, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    )
    assert board.target == PuzzleBoard()
    assert len(board) == 10 * 13
    np.testing.assert_array_equal(board.ij[0], [column + 334, row + 334])
    assert board.ids[0] == 501 * (row + 334) + column + 334
    step = np.diff(board.grid()[:2, 0], axis=0)[0]
    assert abs(step[0]) < 0.5  # upright, and true to scale
    assert step[1] == pytest.approx(14 / 25.4 * 300 * scale, abs=0.5)
