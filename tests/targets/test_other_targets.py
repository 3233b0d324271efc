"""AprilGrids and PuzzleBoards are read, too; plain boards stay plain; what was read survives files and the cache."""

import json
from dataclasses import replace

import numpy as np
import pytest
from coded_scene import aprilgrid, charuco, numbered, puzzleboard, seen

from rcdn.batch.cache import packed, unpacked
from rcdn.calibration.coded import Geometries
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import RcdnError
from rcdn.io import ImageResult
from rcdn.io.formats import image_line, image_of_line
from rcdn.synthetic import Background, BoardSpec, Scene, render
from rcdn.types.target import AprilGrid, Charuco, PuzzleBoard, target_of, target_record


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig(target="auto"))


@pytest.mark.parametrize("more", [{}, {"first": 24}, {"gap": 0.35}], ids=str)
@pytest.mark.parametrize("turn", [0.1, 1.9])
def test_aprilgrids_have_the_numbers_of_kalibr(detector, more, turn):
    drawing = aprilgrid(4, 3, **more)
    image, xy = seen(drawing, width=960, height=720, turn=turn, size=0.75)  # its sides are seen to end
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert right >= 0.9 * shown
    (board,) = detector.boards(image)
    assert (board.target.columns, board.target.first_id) == (4, more.get("first", 0))
    assert board.target.rows in (3, None)
    assert abs(board.target.gap - more.get("gap", 0.3)) < 0.02
    # places on the plane: distances of the drawing, whatever the frame
    flat = drawing.xy[[drawing.ids.tolist().index(n) for n in board.ids.tolist()]]
    ratio = np.linalg.norm(flat - flat[0], axis=1)[1:] / np.linalg.norm(board.points - board.points[0], axis=1)[1:]
    assert np.ptp(ratio) < 0.05 * ratio.mean()


@pytest.mark.parametrize("start", [(0, 0), (333, 250), (497, 498)])
@pytest.mark.parametrize("condition", [{}, {"noise": 40}, {"blur": 2.5}, {"tilt": 1.0}], ids=str)
def test_puzzleboards_have_the_numbers_of_their_authors(detector, start, condition):
    drawing = puzzleboard(11, 8, start)
    image, xy = seen(drawing, turn=0.9, **condition)
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert right >= 0.98 * shown


def test_plain_boards_stay_plain(detector):
    for seed in range(8):
        spec = BoardSpec(9, 6, (0.1 * seed, 0.2, 0.3), (-4.0, -2.5, 12.0))
        scene = Scene(640, 480, 700.0, (319.5, 239.5), boards=(spec,), background=Background("plain", seed), seed=seed)
        for board in detector.boards(render(scene)):
            assert board.target is None
            assert board.ids is None


def test_codes_are_left_alone_if_that_is_asked_for():
    image, _ = seen(charuco(5, 7, "DICT_4X4_50"))
    (board,) = Detector(DetectorConfig(target="plain")).boards(image)
    assert board.target is None
    assert not Detector(DetectorConfig(target="plain")).boards(seen(aprilgrid(4, 3), size=0.9)[0])


def test_what_was_read_survives_files_and_the_cache(detector):
    drawings = (charuco(5, 7, "DICT_4X4_50"), aprilgrid(4, 3), puzzleboard(9, 7, (12, 30)))
    for drawing in drawings:
        image, _ = seen(drawing, size=0.9)
        found = detector.detect(image)
        result = ImageResult("a.png", image.shape[1], image.shape[0], found.corners, tuple(found.boards))
        for again in (image_of_line(image_line(result)), unpacked(json.loads(json.dumps(packed(result))), "a.png")):
            assert again.boards[0].target == found.boards[0].target
            np.testing.assert_array_equal(again.boards[0].ids, found.boards[0].ids)


@pytest.mark.parametrize(
    "target", [Charuco(5, None, "DICT_4X4_50", 0.75, legacy=True), AprilGrid(6, 6, "tag36h11", 0.3), PuzzleBoard()]
)
def test_targets_are_plain_values_and_back(target):
    assert target_of(json.loads(json.dumps(target_record(target)))) == target


@pytest.mark.parametrize(
    "record",
    [
        None,
        {},
        {"kind": "x"},
        {"kind": "charuco"},
        {"kind": "charuco", "columns": 10**9, "rows": 3, "dictionary": "D", "marker": 0.5},
        {"kind": "charuco", "columns": 5, "rows": 3, "dictionary": 7, "marker": 0.5},
        {"kind": "charuco", "columns": 5, "rows": 3, "dictionary": "D", "marker": "a"},
        {"kind": "aprilgrid", "columns": 5, "rows": 3, "family": "tag36h11", "gap": -1},
    ],
)
def test_records_that_are_no_targets_are_refused(record):
    with pytest.raises(RcdnError):
        target_of(record)


def test_parts_of_a_coded_board_have_their_place_on_the_whole(detector):
    image, _ = seen(charuco(7, 9, "DICT_4X4_50"))
    (board,) = detector.boards(image)
    part = np.flatnonzero((board.ij >= 2).all(axis=1))
    cut = replace(board, xy=board.xy[part], ij=board.ij[part], response=board.response[part], status=board.status[part],
                  sigma=board.sigma[part], ids=board.ids[part])  # fmt: skip
    other = replace(board, target=replace(board.target, dictionary="DICT_5X5_50"))
    geometries = Geometries.of([board, cut], 0.03)
    labels = geometries.labelled([board, cut, other], strict=False)
    assert geometries.main.size == (6, 8)
    assert [label.settled for label in labels] == [True, True, False]
    np.testing.assert_array_equal(labels[1].ij, board.ij[part])
    assert "another target" in labels[2].reason
