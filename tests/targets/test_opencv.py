"""`rcdn.detect_charuco` answers as OpenCV's CharucoDetector does, where that one finds the board."""

import cv2
import numpy as np
import pytest
from coded_scene import SQUARE, charuco, seen

import rcdn
from rcdn.errors import ConfigError

KNOWN = cv2.aruco.getPredefinedDictionary


def board_of(columns, rows, dictionary, ratio=0.75, legacy=False, ids=None):
    arguments = (columns, rows), 0.04, 0.04 * ratio, KNOWN(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard(*arguments) if ids is None else cv2.aruco.CharucoBoard(*arguments, np.asarray(ids))
    board.setLegacyPattern(legacy)
    return board


@pytest.mark.parametrize(
    ("size", "dictionary", "options"),
    [
        ((5, 7), "DICT_4X4_50", {}),
        ((8, 6), "DICT_5X5_100", {"ratio": 0.6, "legacy": True}),
        ((7, 5), "DICT_6X6_250", {"legacy": True}),
        ((6, 5), "DICT_4X4_250", {"first": 30}),
        ((6, 6), "DICT_APRILTAG_36h11", {"ratio": 0.8}),
    ],
)
@pytest.mark.parametrize("turn", [0.3, 2.5])
def test_the_same_corners_as_opencv(size, dictionary, options, turn):
    drawing = charuco(*size, dictionary, **options)
    image, truth = seen(drawing, turn=turn, noise=1, seed=4)
    first = options.get("first")
    ids = None if first is None else first + np.arange(size[0] * size[1] // 2)
    board = board_of(*size, dictionary, options.get("ratio", 0.75), options.get("legacy", False), ids)
    corners, numbers = rcdn.detect_charuco(image, board)
    theirs, their_numbers, *_ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    assert (corners.shape, corners.dtype) == ((len(theirs), 1, 2), theirs.dtype)  # OpenCV 5 gives (N, 2)
    assert (numbers.shape, numbers.dtype) == ((len(theirs), 1), their_numbers.dtype)
    assert np.array_equal(numbers.ravel(), their_numbers.ravel())
    apart = (theirs.reshape(-1, 2) - corners[:, 0]).mean(axis=0)
    half = (
        0.5 * (apart > 0.25).all()
    )  # OpenCV 4 (4.9 to 4.12) has its corners half a pixel to the right and below the true ones, 5 hasn't
    assert np.linalg.norm(corners + half - theirs.reshape(-1, 1, 2), axis=2).mean() < 0.1
    assert np.abs(corners[:, 0] - truth[numbers[:, 0]]).max() < 0.1


def test_a_part_of_a_board_has_its_own_numbers():
    image, truth = seen(charuco(8, 6, "DICT_4X4_50"), noise=1)
    corners, ids = rcdn.detect_charuco(image[:, 250:].copy(), board_of(8, 6, "DICT_4X4_50"))
    assert 12 <= len(ids) < 35
    assert np.abs(corners[:, 0] + (250, 0) - truth[ids[:, 0]]).max() < 0.2


def test_the_legacy_flag_need_not_be_right():
    image, truth = seen(charuco(5, 6, "DICT_4X4_50"), noise=1)
    corners, ids = rcdn.detect_charuco(image, board_of(5, 6, "DICT_4X4_50", legacy=True))
    assert ids.ravel().tolist() == list(range(20))
    assert np.abs(corners[:, 0] - truth).max() < 0.2


@pytest.mark.parametrize("legacy", [False, True])
def test_inverted_boards_are_read_where_they_are_said_to_be(legacy):
    image, truth = seen(charuco(5, 6, "DICT_4X4_50", legacy=legacy), noise=1)
    board = board_of(5, 6, "DICT_4X4_50", legacy=legacy)
    corners, ids = rcdn.detect_charuco(255 - image, board, inverted=True)
    assert ids.ravel().tolist() == list(range(20))
    assert np.abs(corners[:, 0] - truth).max() < 0.2
    assert rcdn.detect_charuco(255 - image, board) == (None, None)
    assert rcdn.detect_charuco(image, board, inverted=True) == (None, None)


def test_a_row_beyond_the_given_board_has_no_numbers():
    image, truth = seen(charuco(8, 6, "DICT_4X4_50"), noise=1)
    board = board_of(8, 5, "DICT_4X4_50")
    corners, ids = rcdn.detect_charuco(image, board)
    assert ids.ravel().tolist() == list(range(28))
    assert np.abs(corners[:, 0] - truth[: len(ids)]).max() < 0.2
    points, _ = board.matchImagePoints(corners, ids)
    assert len(points) == len(ids)


def test_nothing_where_there_is_no_such_board():
    image, _ = seen(charuco(5, 7, "DICT_4X4_50"))
    for other in (
        board_of(5, 7, "DICT_5X5_50"),
        board_of(7, 5, "DICT_4X4_50"),
        board_of(5, 7, "DICT_4X4_50", ids=range(20, 37)),
    ):
        corners, ids = rcdn.detect_charuco(image, other)
        assert corners is None
        assert ids is None
    assert rcdn.detect_charuco(np.zeros((100, 100), np.uint8), board_of(5, 7, "DICT_4X4_50")) == (None, None)


def test_dictionaries_are_known_by_their_markers():
    known = KNOWN(cv2.aruco.DICT_4X4_250)
    part = cv2.aruco.Dictionary(known.bytesList[:20], known.markerSize)
    board = cv2.aruco.CharucoBoard((5, 7), SQUARE, SQUARE * 0.75, part)
    image, _ = seen(charuco(5, 7, "DICT_4X4_50"))
    assert len(rcdn.detect_charuco(image, board)[1]) == 24
    own = cv2.aruco.extendDictionary(17, 5)
    with pytest.raises(ConfigError, match="its dictionary has other markers"):
        rcdn.detect_charuco(image, cv2.aruco.CharucoBoard((5, 7), SQUARE, SQUARE * 0.75, own))


def test_boards_that_cannot_be_read_are_refused():
    image = np.zeros((100, 100), np.uint8)
    with pytest.raises(ConfigError, match=r"must be a cv2\.aruco\.CharucoBoard"):
        rcdn.detect_charuco(image, (5, 7))
    with pytest.raises(ConfigError, match="one after the other"):
        rcdn.detect_charuco(image, board_of(5, 7, "DICT_4X4_50", ids=[*range(16), 40]))


def test_markers_in_another_order_are_no_board():
    """Some of them follow each other, as they do on boards; that proves nothing."""
    order = np.random.default_rng(1).permutation(34)
    order[:4] = np.arange(4)
    board = board_of(8, 8, "DICT_4X4_50", ids=order[:32])
    flat = cv2.copyMakeBorder(board.generateImage((768, 768)), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    found = rcdn.Detector(rcdn.DetectorConfig(threads=1, target="auto")).boards(flat)
    assert [b.ids for b in found] == [None]
    assert rcdn.detect_charuco(flat, board_of(8, 8, "DICT_4X4_50"))[1] is None
