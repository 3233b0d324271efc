"""ChArUco boards are read without being told which: every corner gets OpenCV's number, or none."""

import cv2
import numpy as np
import pytest
from coded_scene import charuco, numbered, seen

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.synthetic import Background, BoardSpec, Scene, render
from rcdn.targets.layout import index_of, place_of

BOARDS = [
    (5, 7, "DICT_4X4_50", {}),
    (8, 8, "DICT_4X4_250", {"ratio": 0.6, "legacy": True}),
    (11, 8, "DICT_5X5_100", {"ratio": 0.8}),
    (7, 5, "DICT_6X6_250", {"ratio": 0.7}),
    (8, 6, "DICT_APRILTAG_36h11", {"ratio": 0.8}),
    (9, 6, "DICT_ARUCO_ORIGINAL", {}),
    (5, 4, "DICT_4X4_50", {"inverted": True}),
    (6, 6, "DICT_7X7_250", {"ratio": 0.85, "legacy": True}),
    (6, 5, "DICT_5X5_250", {"first": 37}),
]


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig(target="auto"))


@pytest.mark.parametrize(("columns", "rows", "dictionary", "more"), BOARDS)
@pytest.mark.parametrize("turn", [0.2, 2.5])
def test_every_corner_has_its_number(detector, columns, rows, dictionary, more, turn):
    drawing = charuco(columns, rows, dictionary, **more)
    image, xy = seen(drawing, turn=turn)
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert right == shown
    target = detector.boards(image)[0].target
    assert (target.columns, target.rows, target.legacy) == (columns, rows, more.get("legacy", False))
    assert (target.inverted, target.first_id) == (more.get("inverted", False), more.get("first", 0))
    assert abs(target.marker - more.get("ratio", 0.75)) < 0.03
    assert dictionary.rsplit("_", 1)[0] == target.dictionary.rsplit("_", 1)[0]


@pytest.mark.parametrize(
    "condition", [{"noise": 40}, {"blur": 2}, {"blur": 3}, {"light": 0.2}, {"size": 0.45}], ids=str
)
def test_through_noise_blur_dark_and_distance(detector, condition):
    right = wrong = shown = 0
    for k, (columns, rows, dictionary, more) in enumerate(BOARDS[:8:2]):
        drawing = charuco(columns, rows, dictionary, **more)
        found = numbered(
            detector, *(lambda s, d=drawing: (s[0], d, s[1]))(seen(drawing, turn=0.7 * k, seed=k, **condition))
        )
        right, wrong, shown = (a + b for a, b in zip((right, wrong, shown), found, strict=True))
    assert wrong == 0
    assert right >= 0.98 * shown


def test_boards_cut_by_the_frame_have_right_numbers_or_none(detector):
    total = 0
    for k, (columns, rows, dictionary, more) in enumerate(BOARDS):
        drawing = charuco(columns, rows, dictionary, **more)
        image, xy = seen(drawing, turn=1.1 * k, shift=(210, 130), size=1.1, seed=k)
        right, wrong, _ = numbered(detector, image, drawing, xy)
        assert wrong == 0
        total += right
    assert total > 100


def test_a_covered_board_keeps_its_numbers(detector):
    drawing = charuco(8, 6, "DICT_5X5_100")
    image, xy = seen(drawing)
    cv2.rectangle(image, (250, 150), (380, 260), 90, -1)
    right, wrong, _ = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert right > 15


@pytest.mark.parametrize("bits", [4, 5, 6, 7])
def test_boards_with_random_codes_have_no_numbers(detector, bits):
    """As likely as not each module: the null hypothesis of the evidence."""
    for seed in range(5):
        spec = BoardSpec(9, 6, (0.2, 0.1 * seed, 0.3 * seed), (-4.0, -2.5, 13.0), coded=bits, swap=bool(seed % 2))
        scene = Scene(640, 480, 700.0, (319.5, 239.5), boards=(spec,), background=Background("plain", seed), seed=seed)
        boards = detector.boards(render(scene))
        assert boards
        assert all(board.target is None for board in boards)


@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (8, 8), (7, 5), (4, 5), (6, 6)])
@pytest.mark.parametrize("legacy", [False, True])
def test_the_layout_is_that_of_opencv(columns, rows, legacy):
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, 0.5, known)
    board.setLegacyPattern(legacy)
    middles = np.array([np.asarray(p)[:, :2].mean(axis=0) for p in board.getObjPoints()])
    odd = not (legacy and rows % 2 == 0)
    column, row = place_of(np.arange(len(middles)), np.array(columns), np.array(odd))
    np.testing.assert_allclose(np.stack([column, row], axis=1) + 0.5, middles, atol=1e-5)
    assert index_of(column, row, np.array(columns), np.array(odd)).tolist() == list(range(len(middles)))
