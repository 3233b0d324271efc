"""A detector that is told its target reads that one alone, and smaller parts of it."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from coded_scene import aprilgrid, charuco, numbered, puzzleboard, seen

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.synthetic import Background, BoardSpec, Scene, render
from rcdn.targets import identified
from rcdn.types import AprilGrid, Board, Charuco, PuzzleBoard
from rcdn.types.target import target_of, target_record

RIG = Charuco(4, 5, "DICT_4X4_50", 0.75, inverted=True)
TAGS = AprilGrid(4, 3, "tag36h11", 0.3)


@pytest.mark.parametrize(
    ("target", "drawing"),
    [
        (RIG, charuco(4, 5, "DICT_4X4_50", inverted=True)),
        (Charuco(8, 8, "DICT_5X5_100", 0.7, legacy=True), charuco(8, 8, "DICT_5X5_100", 0.7, legacy=True)),
        (Charuco(6, 5, "DICT_6X6_250", 0.75, first_id=37), charuco(6, 5, "DICT_6X6_250", first=37)),
        (TAGS, aprilgrid(4, 3)),
        (PuzzleBoard(), puzzleboard(9, 7, (100, 200))),
    ],
    ids=["inverted", "legacy", "first", "aprilgrid", "puzzleboard"],
)
def test_the_told_target_is_read(target, drawing):
    detector = Detector(DetectorConfig(target=target))
    image, xy = seen(drawing, width=800, height=600, turn=0.4)
    right, wrong, shown = numbered(detector, image, drawing, xy)
    assert wrong == 0
    assert right >= 0.9 * shown
    assert detector.boards(image)[0].target == target


def part_of(board: Board, columns: int, rows: int) -> Board:
    """The part of a plain board at its upper left."""
    rows_kept = np.flatnonzero((board.ij < [columns, rows]).all(axis=1))
    pick = {name: getattr(board, name)[rows_kept] for name in ("xy", "ij", "response", "status")}
    return replace(board, **pick, sigma=None)


def test_legacy_says_nothing_of_an_odd_number_of_rows():
    """What is printed beside the corners is the same, and so are the corners."""
    image, _ = seen(charuco(8, 7, "DICT_5X5_100", 0.8), noise=1)
    target = Charuco(8, 7, "DICT_5X5_100", 0.8)
    one, two = (Detector(DetectorConfig(target=t)).boards(image)[0] for t in (target, replace(target, legacy=True)))
    assert np.array_equal(one.xy, two.xy)
    assert np.array_equal(one.ids, two.ids)
    assert Charuco(8, 7, "DICT_5X5_100", 0.8, legacy=True) == Charuco(8, 7, "DICT_5X5_100", 0.8)
    assert replace(Charuco(8, None, "DICT_5X5_100", 0.8, legacy=True), rows=7).legacy is False
    assert Charuco(8, 6, "DICT_5X5_100", 0.8, legacy=True) != Charuco(8, 6, "DICT_5X5_100", 0.8)


@pytest.mark.parametrize("size", [(8, 8), (5, 6), (6, 4)], ids=str)
@pytest.mark.parametrize("printed", [False, True], ids=["current", "legacy"])
def test_the_other_layout_is_read_and_named(size, printed):
    """Few know which layout their board has. Boards with an odd number of columns, moved by a column, have nearly all
    markers of the other layout."""
    drawing = charuco(*size, "DICT_4X4_50", legacy=printed)
    image, xy = seen(drawing, noise=2)
    for asked in (False, True):
        detector = Detector(DetectorConfig(target=Charuco(*size, "DICT_4X4_50", 0.75, legacy=asked)))
        assert numbered(detector, image, drawing, xy) == (len(xy), 0, len(xy))
        (board,) = detector.boards(image)
        assert board.target == Charuco(*size, "DICT_4X4_50", 0.75, legacy=printed)
        assert np.abs(board.xy - xy[board.ids]).max() < 0.2  # the codes are part of the fit: those that are there


@pytest.mark.parametrize(("legacy", "columns"), [(False, slice(300, None)), (True, slice(0, 340))])
def test_a_side_that_is_seen_to_end_tells_the_layout(legacy, columns):
    """Cut on the other side, boards of odd columns and even rows have the markers of the other layout, moved by a
    column."""
    drawing = charuco(5, 6, "DICT_4X4_50", legacy=legacy)
    image, xy = seen(drawing, noise=2)
    detector = Detector(DetectorConfig(target=Charuco(5, 6, "DICT_4X4_50", 0.75, legacy=not legacy)))
    (board,) = detector.boards(image[:, columns].copy())
    assert 8 <= len(board) < len(xy)
    assert board.target.legacy == legacy
    assert np.abs(board.xy + np.array([columns.start, 0]) - xy[board.ids]).max() < 0.2


def test_smaller_parts_are_certain_than_of_any_target():
    """What competes is the places of one board, not all boards; and no part gets a wrong number."""
    given = Charuco(8, 6, "DICT_4X4_50", 0.75)
    drawing, plain = charuco(8, 6, "DICT_4X4_50"), Detector(DetectorConfig(target="plain", sharpen=None))
    certain = {"auto": 0, "given": 0}
    for k in range(6):
        image, xy = seen(drawing, turn=1.1 * k, seed=k)
        part = part_of(plain.boards(image)[0], 4, 3)  # six squares, three markers
        place = dict(zip(drawing.ids.tolist(), xy, strict=True))
        hidden = np.ones_like(image)
        cv2.fillConvexPoly(hidden, cv2.convexHull(np.round(part.xy).astype(np.int32)), 0)
        image[hidden == 1] = 128
        for name, target in (("auto", None), ("given", given)):
            found = identified(image, part, target)
            certain[name] += found.target is not None
            for number, at in zip([] if found.ids is None else found.ids.tolist(), found.xy, strict=False):
                assert np.linalg.norm(place[number] - at) < 3
    assert certain == {"auto": 0, "given": 6}


@pytest.mark.parametrize(
    "other",
    [
        replace(RIG, inverted=False), replace(RIG, dictionary="DICT_5X5_50"), replace(RIG, first_id=20),
        TAGS, PuzzleBoard(),
    ],
    ids=str,
)  # fmt: skip
def test_another_target_stays_plain(other):
    drawing = charuco(4, 5, "DICT_4X4_50", inverted=True)
    boards = Detector(DetectorConfig(target=other)).boards(seen(drawing)[0])
    assert boards
    assert all(board.target is None for board in boards)


@pytest.mark.parametrize("target", [RIG, Charuco(9, 7, "DICT_4X4_1000", 0.7)], ids=str)
def test_random_codes_have_no_numbers(target):
    """Each module as likely as not: the null hypothesis of the evidence."""
    detector = Detector(DetectorConfig(target=target, sharpen=None, pyramid=False))
    for seed in range(12):
        spec = BoardSpec(9, 6, (0.2, 0.1 * (seed % 4), 0.3 * seed), (-4.0, -2.5, 16.0), coded=4, swap=bool(seed % 2))
        scene = Scene(640, 480, 700.0, (319.5, 239.5), boards=(spec,), background=Background("plain", seed), seed=seed)
        boards = detector.boards(render(scene))
        assert boards
        assert all(board.target is None for board in boards)


@pytest.mark.parametrize("target", [RIG, TAGS, PuzzleBoard()], ids=str)
def test_settings_with_a_target_go_to_json_and_back(target):
    config = DetectorConfig(target=target)
    again = DetectorConfig.from_json(config.to_json())
    assert again == config
    assert hash(again) == hash(config)
    assert again.to_json() != DetectorConfig().to_json()


@pytest.mark.parametrize("target", ["charuco", None, 3, Charuco, {"columns": 8}])
def test_what_is_no_target_is_refused(target):
    with pytest.raises(ConfigError, match="target"):
        DetectorConfig(target=target)


@pytest.mark.parametrize(
    ("target", "changes", "words"),
    [
        (RIG, {"columns": 1}, "Charuco.columns must be a whole number from 2 to 1000, not 1"),
        (RIG, {"columns": 4.0}, "Charuco.columns must be"), (RIG, {"rows": 0}, "Charuco.rows must be"),
        (RIG, {"columns": True}, "Charuco.columns must be"), (RIG, {"first_id": -1}, "Charuco.first_id must be"),
        (RIG, {"marker": 7.5}, "Charuco.marker must lie between 0 and 1, not 7.5"),
        (RIG, {"marker": "0.5"}, "Charuco.marker"), (RIG, {"marker": 10**400}, "Charuco.marker"),
        (RIG, {"marker": np.nan}, "Charuco.marker"),
        (RIG, {"dictionary": 4}, "Charuco.dictionary must be a name"), (RIG, {"legacy": 1}, "Charuco.legacy must be"),
        (RIG, {"inverted": "no"}, "Charuco.inverted must be"), (TAGS, {"columns": 0}, "AprilGrid.columns must be"),
        (TAGS, {"gap": 1}, "AprilGrid.gap must lie"), (TAGS, {"border": 0}, "AprilGrid.border must be"),
        (TAGS, {"rows": "4"}, "AprilGrid.rows must be"), (TAGS, {"family": None}, "AprilGrid.family must be a name"),
    ],
)  # fmt: skip
def test_fields_out_of_range_are_refused_where_a_target_is_made(target, changes, words):
    with pytest.raises(ConfigError, match=words):
        replace(target, **changes)


def test_fields_of_numpy_s_types_become_python_s():
    made = replace(RIG, columns=np.int64(4), rows=np.uint8(5), marker=np.float32(0.75), inverted=np.True_)
    assert made == RIG
    assert repr(made) == repr(RIG)
    assert DetectorConfig.from_json(DetectorConfig(target=made).to_json()).target == RIG


def test_every_first_marker_of_a_dictionary_is_one():
    made = Charuco(4, 5, "DICT_APRILTAG_36h10", 0.75, first_id=2310)
    assert target_of(target_record(made)) == made


def test_a_damaged_target_in_settings_is_refused():
    plain = json.loads(DetectorConfig(target=RIG).to_json())
    plain["target"]["columns"] = -4
    with pytest.raises(ConfigError, match="columns"):
        DetectorConfig.from_json(json.dumps(plain))


@pytest.mark.parametrize(
    "target", [replace(RIG, dictionary="DICT_3X3"), AprilGrid(6, 6, "tagCircle21h7", 0.3)], ids=["charuco", "aprilgrid"]
)
def test_unknown_dictionaries_are_refused_with_those_that_are_known(target):
    with pytest.raises(ConfigError, match=r"one of .*(DICT_4X4_50|tag36h11)"):
        Detector(DetectorConfig(target=target))
