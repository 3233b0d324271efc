"""Other readers of codes: their numbers and pixels are brought to ours, as rendered boards show."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.synthetic import Background, Scene, Sensor
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.types import AprilGrid, Charuco, PuzzleBoard
from rcdn_lab.coded.drawings import aprilgrid_drawing, charuco_drawing, puzzleboard_drawing
from rcdn_lab.coded.views import drawing_truth, posed, render_drawing
from rcdn_lab.peers.coded import CODED_PEERS
from rcdn_lab.peers.coded.base import corners_of_tag

FRAME = Scene(800, 600, 900.0, (399.5, 299.5), sensor=Sensor(blur=0.6, noise=1.0), background=Background("plain", 2))
CASES = [
    ("opencv", charuco_drawing(7, 5, "DICT_5X5_100"), Charuco(7, 5, "DICT_5X5_100", 0.75)),
    ("opencv", charuco_drawing(6, 6, "DICT_4X4_50", 0.7, True), Charuco(6, 6, "DICT_4X4_50", 0.7, legacy=True)),
    ("opencv", charuco_drawing(5, 4, "DICT_4X4_50", inverted=True), Charuco(5, 4, "DICT_4X4_50", 0.75, inverted=True)),
    ("opencv", charuco_drawing(5, 4, "DICT_4X4_50", first=9), Charuco(5, 4, "DICT_4X4_50", 0.75, first_id=9)),
    ("opencv", aprilgrid_drawing(4, 3), AprilGrid(4, 3, "tag36h11", 0.3)),
    ("opencv", aprilgrid_drawing(3, 3, "DICT_APRILTAG_25h9", 1), AprilGrid(3, 3, "tag25h9", 0.3, 1)),
    ("aprilgrid", aprilgrid_drawing(4, 3), AprilGrid(4, 3, "tag36h11", 0.3)),
    ("aprilgrid", aprilgrid_drawing(3, 3, "DICT_APRILTAG_16h5", 1), AprilGrid(3, 3, "tag16h5", 0.3, 1)),
    ("calib-targets", charuco_drawing(7, 5, "DICT_5X5_100"), Charuco(7, 5, "DICT_5X5_100", 0.75)),
    ("calib-targets", puzzleboard_drawing(10, 8, (12, 30), (CODE_1, CODE_2)), PuzzleBoard()),
    ("calib-targets", puzzleboard_drawing(10, 8, (400, 120), (CODE_1, CODE_2)), PuzzleBoard()),
]


@pytest.mark.parametrize(("name", "drawing", "target"), CASES, ids=lambda x: str(x) if not hasattr(x, "image") else "")
def test_readers_give_the_numbers_of_the_truth(name, drawing, target):
    peer = CODED_PEERS[name]
    if peer.missing():
        pytest.skip(str(peer.missing()))
    assert peer.reads(target)
    known = replace(FRAME, boards=(posed(drawing, FRAME.camera, (10, 10, 789, 589), 0.3, 0.7, 0.4),))
    truth = drawing_truth(drawing, known)
    place = dict(zip(truth.ids.tolist(), truth.xy, strict=True))
    (board,) = peer.load()(render_drawing(drawing, known), target)
    assert len(board.ids) >= 0.75 * len(drawing.ids)
    gap = np.array([np.linalg.norm(place[n] - xy) for n, xy in zip(board.ids.tolist(), board.xy, strict=True)])
    assert np.percentile(gap, 25) < 0.2
    assert gap.max() < 0.3 * truth.pitch.min()


@pytest.mark.parametrize("name", CODED_PEERS)
def test_nothing_is_read_where_there_is_nothing(name):
    peer = CODED_PEERS[name]
    if peer.missing():
        pytest.skip(str(peer.missing()))
    read, image = peer.load(), np.full((240, 320), 90, np.uint8)
    for target in (Charuco(5, 4, "DICT_4X4_50", 0.75), AprilGrid(4, 3, "tag36h11", 0.3), PuzzleBoard()):
        assert read(image, target) == []


def test_targets_that_a_reader_does_not_know_are_said():
    assert not CODED_PEERS["opencv"].reads(PuzzleBoard())
    assert not CODED_PEERS["aprilgrid"].reads(AprilGrid(4, 3, "tag36h10", 0.3))
    assert not CODED_PEERS["calib-targets"].reads(Charuco(6, 6, "DICT_4X4_50", 0.7, legacy=True))


def test_corners_of_tags_are_those_of_kalibr():
    board = AprilGrid(6, 6, "tag36h11", 0.3)
    assert corners_of_tag(board, 0) == [0, 1, 13, 12]
    assert corners_of_tag(board, 7) == [26, 27, 39, 38]
    assert corners_of_tag(board, 36) == []
