"""Boards seen in a mirror have no numbers, and the detection says so."""

import numpy as np
import pytest
from coded_scene import aprilgrid, charuco, puzzleboard, seen

from rcdn import Detector, DetectorConfig

DETECTOR = Detector(DetectorConfig(threads=1, target="auto"))
BOARDS = {
    "charuco": charuco(5, 7, "DICT_4X4_50"),
    "legacy": charuco(8, 8, "DICT_5X5_100", legacy=True),
    "aprilgrid": aprilgrid(4, 3),
    "puzzleboard": puzzleboard(9, 7, (20, 40)),
}


@pytest.mark.parametrize("kind", BOARDS)
@pytest.mark.parametrize("axis", [0, 1], ids=["upside down", "left to right"])
def test_a_mirrored_board_is_told_and_has_no_numbers(kind, axis):
    image, _ = seen(BOARDS[kind], turn=0.4, seed=1)
    straight, mirrored = (DETECTOR.detect(np.ascontiguousarray(a)) for a in (image, np.flip(image, axis)))
    assert straight.boards[0].target is not None
    assert straight.warnings == ()
    assert all(board.target is None and board.ids is None for board in mirrored.boards)
    assert [text.split(":")[0] for text in mirrored.warnings] == ["mirrored"]
    assert str(straight.boards[0].target) in mirrored.warnings[0]


def test_a_mirrored_board_is_still_a_board():
    image, _ = seen(BOARDS["charuco"])
    board = DETECTOR.boards(np.ascontiguousarray(image[:, ::-1]))[0]
    assert board.complete
    assert sorted(board.size) == [4, 6]


def test_of_plain_boards_and_unreadable_ones_nothing_is_told():
    plain = np.kron(np.add.outer(np.arange(8), np.arange(11)) % 2, np.ones((40, 40))).astype(np.uint8) * 200
    assert DETECTOR.detect(plain).warnings == ()
    blurred, _ = seen(BOARDS["charuco"], 320, 240, size=0.6, blur=3.0, noise=20)
    assert DETECTOR.detect(blurred[:, ::-1].copy()).warnings == ()
