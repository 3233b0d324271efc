"""Codes that contradict each other give no numbers: torn frames, and prints whose parts don't belong together."""

from dataclasses import replace

import numpy as np
import pytest
from coded_scene import SQUARE, Drawing, aprilgrid, charuco, numbered, puzzleboard, seen

from rcdn import Detector, DetectorConfig
from rcdn.targets.charuco_layouts import contradicted
from rcdn.types import AprilGrid, Charuco
from rcdn_lab.coded.drawings import MARGIN, TAG

AUTO = Detector(DetectorConfig(threads=1, target="auto"))
STEP = TAG + round(0.3 * TAG)
BOARDS = {
    "charuco": charuco(8, 8, "DICT_4X4_50"),
    "legacy": charuco(8, 8, "DICT_5X5_100", legacy=True),
    "tags": charuco(8, 6, "DICT_APRILTAG_36h11", ratio=0.8),
    "puzzleboard": puzzleboard(11, 8, (20, 40)),
}


def torn(drawing: Drawing, share: float) -> np.ndarray:
    """A picture of the drawing, from `share` of the corners downwards shifted to the right by two squares."""
    image, xy = seen(drawing, tilt=0.0, size=0.9)
    shift, line = round(2 * np.linalg.norm(xy[1] - xy[0])), int(np.quantile(xy[:, 1], share))
    image[line:] = np.roll(image[line:], shift, axis=1)
    return image


def exchanged(drawing: Drawing, row: int, rows: int, columns: int, pitch: int, by: int) -> Drawing:
    """The drawing with `rows` rows from `row` on, of `columns` columns, moved to the right by `by` of them; what leaves
    them on the right enters them on the left. `pitch`, px, of columns and rows."""
    image = drawing.image.copy()
    strip = np.s_[MARGIN + row * pitch : MARGIN + (row + rows) * pitch, MARGIN : MARGIN + columns * pitch]
    image[strip] = np.roll(image[strip], by * pitch, axis=1)
    return replace(drawing, image=image)


def assert_contradictory(detector: Detector, image: np.ndarray) -> None:
    found = detector.detect(image)
    assert all(board.ids is None and board.target is None for board in found.boards)
    assert [text.split(": ")[0] for text in found.warnings] == ["contradictory"]
    assert "corners have no numbers, since their codes contradict each other" in found.warnings[0]


@pytest.mark.parametrize(
    ("kind", "share"),
    [("charuco", 0.25), ("charuco", 0.7), ("legacy", 0.5), ("tags", 0.7), ("puzzleboard", 0.25)],
)
def test_a_torn_frame_has_no_numbers(kind, share):
    image = torn(BOARDS[kind], share)
    assert_contradictory(AUTO, image)


def test_a_torn_frame_of_a_told_board_has_no_numbers():
    for share in (0.25, 0.7):
        told = Detector(DetectorConfig(threads=1, target=Charuco(8, 8, "DICT_4X4_50", 0.75)))
        assert_contradictory(told, torn(BOARDS["charuco"], share))


@pytest.mark.parametrize("told", [None, AprilGrid(6, 4, "tag36h11", 0.3)], ids=["unknown", "told"])
def test_tags_of_one_row_in_other_places_leave_none_a_number(told):
    drawing = aprilgrid(6, 4)
    detector = AUTO if told is None else Detector(DetectorConfig(threads=1, target=told))
    assert detector.boards(seen(drawing)[0])[0].target is not None
    assert_contradictory(detector, seen(exchanged(drawing, 2, 1, 6, STEP, 1))[0])


def test_markers_of_two_rows_in_other_places_leave_none_a_number():
    assert_contradictory(AUTO, seen(exchanged(BOARDS["charuco"], 5, 2, 8, SQUARE, 2))[0])


def square(i: int, j: int) -> tuple[slice, slice]:
    """The pixels of a square of a drawing."""
    return np.s_[MARGIN + j * SQUARE : MARGIN + (j + 1) * SQUARE, MARGIN + i * SQUARE : MARGIN + (i + 1) * SQUARE]


def test_one_marker_of_another_place_leaves_the_others_their_numbers():
    drawing = BOARDS["charuco"]
    image = drawing.image.copy()
    image[square(3, 4)] = drawing.image[square(6, 1)]
    picture, xy = seen(replace(drawing, image=image))
    assert numbered(AUTO, picture, drawing, xy) == (49, 0, 49)
    assert AUTO.detect(picture).warnings == ()


def test_squares_that_cannot_be_read_do_not_contradict():
    most, gain = np.array([40.0] * 8 + [-4.0] * 20), np.array([40.0] * 8 + [-4.3] * 20)
    assert not contradicted(most, gain, 50)
    gain[0] = -4.3  # one against seven
    assert contradicted(most, gain, 50)
    most[0] = 10.0  # which may be chance among 50 markers: 5 bits and log2 of 50 are 10.6
    assert not contradicted(most, gain, 50)
