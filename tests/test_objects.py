"""What values look like, and that copies and pickles of them are as good as they are."""

import copy
import functools
import pickle
import re
import xml.etree.ElementTree as ET
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

import rcdn
from rcdn.calibration.comparison import compare
from rcdn.calibration.guidance import Guide, PairGuide
from rcdn.config import DetectorConfig, MaxFraction
from rcdn.geometry import zero_correction
from rcdn.io import ImageResult, StereoCameras
from rcdn.synthetic import PRESETS, random_scene, render
from rcdn.types import (
    BoardShape,
    Corners,
    FixedBoard,
    Pose,
    Reason,
    Rig,
    RigCalibration,
    RigPair,
    RigPoseEstimate,
    StereoCalibration,
    Verdict,
)
from rcdn.types.named import Named
from rcdn.types.shown import decimals
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda value: pickle.loads(pickle.dumps(value))}
pytestmark = pytest.mark.xdist_group("objects")  # one picture and one calibration


@functools.cache
def picture():
    return render(random_scene(np.random.default_rng((1, 1)), PRESETS["ordinary"], (640, 480)))


@functools.cache
def detection():
    return rcdn.Detector().detect(picture())


@functools.cache
def boards():
    return random_boards(CAMERAS["brown"], 1)[0]


@functools.cache
def calibration():
    return rcdn.calibrate(boards(), spacing=SPACING, model="brown", flat=True)


@functools.cache
def pair():
    return StereoCalibration(
        calibration(), calibration(), np.eye(4) - 0.1 * np.eye(4, k=3), np.eye(6), 0.1, 0.2, *[np.eye(3)] * 2,
        *[np.eye(3, 4)] * 2, np.eye(4)
    )  # fmt: skip


RIG = Rig(("left", "<right>"), (CAMERAS["brown"],) * 2, (Pose(np.eye(4)), Pose(np.eye(4) - 0.25 * np.eye(4, k=3))))


@functools.cache
def many():
    return RigCalibration(
        RIG, {"left": calibration(), "<right>": calibration(), "alone": calibration()}, {(0, 0): np.eye(4)}, 0.1,
        (RigPair("left", "<right>", 3, 2, 0.1),), (("left", "<right>"), ("alone",)),
        fixed_boards=(FixedBoard(0, "ChArUco 9x7", 0, np.eye(4), np.zeros((6, 6))),),
    )  # fmt: skip


@functools.cache
def guide():
    """A guide that has taken two boards, and one that has taken those of the calibration."""
    few = Guide((640, 480), SPACING, model="brown")
    few.add_all({str(k): board for k, board in enumerate(boards()[:2])})
    many = Guide((640, 480), SPACING, model="brown")
    many.add_all({str(k): board for k, board in enumerate(boards())})
    return few, many


@functools.cache
def pair_guide():
    """A guide of two cameras without any moment, and one with one."""
    none = PairGuide(((640, 480), (640, 480)), SPACING, model="brown", size=(9, 6))
    some = PairGuide(((640, 480), (640, 480)), SPACING, model="brown", size=(9, 6))
    whole = next(b for b in boards() if b.complete)
    some.add((whole, replace(whole, xy=whole.xy - [20.0, 1.0])), "0")
    return none, some


VALUES = {
    "corners": lambda: detection().corners,
    "board": lambda: detection().boards[0],
    "detection": detection,
    "camera": lambda: CAMERAS["brown"],
    "splined camera": lambda: replace(CAMERAS["pinhole"], correction=zero_correction(CAMERAS["pinhole"], 5)),
    "correction": lambda: zero_correction(CAMERAS["pinhole"], 5),
    "calibration": calibration,
    "shape": lambda: BoardShape(np.arange(162.0).reshape(6, 9, 3) * 1e-5),
    "shape of nothing": lambda: BoardShape(np.zeros((0, 9, 3))),
    "comparison": lambda: compare(calibration(), calibration().camera),
    "difference": lambda: compare(CAMERAS["brown"], CAMERAS["pinhole"]).found,
    "pair": pair,
    "cameras of a pair": lambda: StereoCameras.of(pair()),
    "rectification": lambda: StereoCameras.of(pair()).turns,
    "rig": lambda: RIG,
    "rig calibration": many,
    "view": lambda: calibration().views[0],
    "verdict": lambda: calibration().verdict,
    "pose": lambda: rcdn.estimate_pose(boards()[0], calibration().camera, spacing=SPACING),
    "plain pose": lambda: Pose(np.eye(4)),
    "config": lambda: DetectorConfig.paper(threads=1),
    "detector": rcdn.Detector,
    "deviations": lambda: calibration().std,
    "rig pose": lambda: RigPoseEstimate(np.eye(4), np.eye(6), 0.1, {"left": np.zeros((54, 2))}, {}),
    "fixed board": lambda: many().fixed_boards[0],
    "image": lambda: ImageResult("a/b.png", 640, 480, detection().corners, detection().boards),
    "look": lambda: guide()[1].look(boards()[0], 0.0),
    "look at nothing": lambda: guide()[1].look(None, 0.0),
    "look of two": lambda: pair_guide()[1].look((boards()[0], None), 0.0),
    "progress": lambda: guide()[1].progress,
    "first progress": lambda: guide()[0].progress,
    "progress of two": lambda: pair_guide()[1].progress,
    "first progress of two": lambda: pair_guide()[0].progress,
    "next view": lambda: guide()[1].progress.wanted,
    "next pair": lambda: pair_guide()[1].progress.wanted,
}


def arrays(value):
    """All arrays in a value, in order."""
    if isinstance(value, np.ndarray):
        return [value]
    if is_dataclass(value):
        return [a for field in fields(value) for a in arrays(getattr(value, field.name))]
    return [a for part in value for a in arrays(part)] if isinstance(value, (list, tuple)) else []


def elements(html, tag):
    """The elements of a name in HTML that is well-formed XML, too."""
    return [e for e in ET.fromstring(f"<div>{html}</div>").iter() if e.tag.rpartition("}")[2] == tag]


@pytest.mark.parametrize("name", VALUES)
def test_every_value_is_one_short_line(name):
    text = repr(VALUES[name]())
    assert "\n" not in text
    assert "array(" not in text
    assert 5 < len(text) < 200


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", VALUES)
def test_copies_are_equal_and_as_unchangeable(name, way):
    value = VALUES[name]()
    twin = COPIES[way](value)
    assert type(twin) is type(value)
    assert repr(twin) == repr(value)
    for mine, its in zip(arrays(value), arrays(twin), strict=True):
        assert np.array_equal(mine, its, equal_nan=True)
        assert its.flags.writeable == mine.flags.writeable


def test_what_reprs_say():
    board, corners = detection().boards[0], detection().corners
    assert repr(board).startswith(f"<Board {board.size[0]}×{board.size[1]} complete, {len(board)} corners, checker, ")
    assert repr(corners).startswith(f"<Corners: {len(corners)} – ")
    assert repr(Corners([], [], [])) == "<Corners: 0>"
    assert repr(detection()) == f"<Detection: {len(corners)} corners, 1 board>"
    assert repr(replace(detection(), boards=[], warnings=("a",))).endswith(" corners, 0 boards, 1 warning>")
    assert repr(calibration()).startswith(f"<Calibration: {calibration().verdict.level}, brown 640×480 px, rms 0.2")
    assert repr(BoardShape(np.eye(3)[None] * 1e-3)) == "<BoardShape 3×1 corners: bend 0.001 m, print error 0.000816 m>"
    assert " px over the area that the boards cover, " in repr(compare(calibration(), calibration()))
    assert "fx 520, fy 515, cx 330, cy 236, k1 -0.28" in repr(CAMERAS["brown"])
    assert repr(pair()).startswith("<StereoCalibration: not judged, baseline 0.1 m, ")
    bad = Verdict("bad", (Reason("rms", "bad", "RMS", 9.0, 1.0, "px", "The RMS is 9 px.", "Look."),))
    few, several = guide()
    assert repr(few.progress) == "<Progress: 2 views, no camera yet>"
    assert re.fullmatch(r"<Progress: \d+ views, worst [\d.]+ px, wanted 0.1 px>", repr(several.progress))
    assert repr(replace(several.progress, worst=0.0851, done=True)).endswith("worst 0.085 px, wanted 0.1 px, done>")
    assert repr(several.look(None, 0.0)) == "<Look: refused, 'No board is seen.', fit 0.00, gain 0.00>"
    assert repr(replace(several.look(None, 0.0), refused="", take=True)) == "<Look: take it, fit 0.00, gain 0.00>"
    assert repr(pair_guide()[0].progress) == "<PairProgress: 0 moments, no pair of cameras yet>"
    view = replace(several.progress.wanted, middle=np.array([101.6, 50.2]), distance=0.456, tilt=30.0)
    view = replace(view, before=1.23, after=0.5)
    assert repr(view) == (
        "<NextView: 9×6 board at (102, 50) px, 0.46 m away, tilted by 30°, worst 1.2 px before, 0.5 px after>"
    )
    wanted = replace(pair_guide()[1].progress.wanted, views=(view, None), lead=0)
    assert repr(wanted) == "<NextPair: left at (102, 50) px, right not to see it, 0.46 m away, tilted by 30°>"
    assert repr(bad) == "<Verdict bad, 1 of 1 checks against it: The RMS is 9 px.>"


@pytest.mark.parametrize(
    "config",
    [
        DetectorConfig(),
        DetectorConfig(pyramid=False, threshold=MaxFraction(0.3)),
        DetectorConfig.paper(),
        DetectorConfig.paper(border=3.0, model="a.onnx"),
    ],
)
def test_the_repr_of_a_config_is_python_that_makes_it(config):
    text = repr(config)
    assert eval(text, {"DetectorConfig": DetectorConfig, "MaxFraction": MaxFraction}) == config
    assert len(text) < 90


def test_a_board_is_drawn_where_it_is():
    board = detection().boards[0]
    html = board._repr_html_()
    assert elements(html, "svg")[0].get("viewBox") == "-.5 -.5 640 480"
    first, *_ = (e for e in elements(html, "circle") if e.get("fill") == "none")
    corner = board.xy[np.lexsort(board.ij.T)[0]]
    assert [float(first.get("cx")), float(first.get("cy"))] == pytest.approx(corner, abs=0.06)
    assert len(elements(html, "polyline")) == board.size[1]
    assert len(elements(html, "circle")) == len(board) + 1
    lines = [len(e.get("points").split()) for e in elements(html, "polyline")]
    assert lines == [board.size[0]] * board.size[1]


def test_a_detection_draws_all_and_says_each():
    twice = replace(detection(), boards=[detection().boards[0]] * 2)
    html = twice._repr_html_()
    assert len({e.get("stroke") for e in elements(html, "polyline")}) == 2
    assert len(elements(html, "p")) == 3
    assert elements(replace(detection(), boards=[])._repr_html_(), "svg") == []


def test_a_calibration_shows_its_verdict_and_each_parameter_with_its_deviation():
    bad = Verdict("bad", (Reason("rms", "bad", "RMS", 9.0, 1.0, "px", "It is <wrong>.", "Look."),))
    html = replace(calibration(), verdict=bad)._repr_html_()
    assert [e.text for e in elements(html, "p")][:2] == ["Calibration: bad", "It is <wrong>. Look."]
    cells = [e.text for e in elements(html, "td")]
    assert cells[::3] == list(calibration().camera.parameter_names)
    for value, deviation, shown, after in zip(
        calibration().camera.parameters, calibration().std, cells[1::3], cells[2::3], strict=True
    ):
        assert float(shown) == pytest.approx(value, abs=0.06 * deviation)
        assert float(after) == pytest.approx(deviation, rel=0.06)
    assert len(elements(pair()._repr_html_(), "table")) == 2
    assert len(elements(CAMERAS["fisheye"]._repr_html_(), "td")) == 2 * 8


def test_a_rig_says_where_its_cameras_stand():
    """T_cam_rig moves by −.25 m along x: the camera's centre is at x = +.25 m."""
    cells = [e.text for e in elements(RIG._repr_html_(), "td")]
    assert cells == ["left", "brown", "640×480", "0, 0, 0", "<right>", "brown", "640×480", "0.25, 0, 0"]
    html = many()._repr_html_()
    assert [e.text for e in elements(html, "p")] == ["Rig calibration: not judged", "2 of 3 cameras, rms 0.1 px"]
    rows = [[c.text or "" for c in row] for row in elements(html, "tr")][1:]
    assert [row[0] for row in rows] == ["left", "<right>", "alone"]
    assert rows[2][1] == "not connected"
    assert float(rows[0][4]) == pytest.approx(calibration().rms, rel=0.01)


def test_the_poses_of_a_rig_can_t_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        RIG.T_cam_rig[1, 0, 3] = 7
    assert RIG.T_cam_rig[1, 0, 3] == -0.25


def test_decimals_leave_two_digits_of_a_deviation():
    assert [decimals(s) for s in (12.0, 0.74, 0.0741, 0.00123, np.nan, np.inf)] == [1, 2, 3, 4, 4, 4]


def test_deviations_have_names():
    std, plain = calibration().std, np.sqrt(np.diag(calibration().cov)[:-6])
    assert std.keys() == calibration().camera.parameter_names
    assert {name: std[name] for name in std.keys()} == dict(  # noqa: SIM118
        zip(std.keys(), plain.tolist(), strict=True)
    )
    assert dict(std.items())["cy"] == std["cy"] == plain[3]
    assert "cy" in std
    assert "k9" not in std
    with pytest.raises(KeyError, match="k9: not one of fx, fy, cx"):
        std["k9"]


def test_deviations_compute_as_arrays_do():
    std, plain = calibration().std, np.array(calibration().std)
    for found, wanted in ((std / 2, plain / 2), (std[2:4], plain[2:4]), (np.concatenate([std, std]), [*plain, *plain])):
        assert type(found) is np.ndarray
        assert np.array_equal(found, wanted)
    assert isinstance(std, np.ndarray)
    assert std.max() == plain.max()
    assert isinstance(std.max(), np.float64)
    assert isinstance(np.mean(std), np.float64)
    with pytest.raises(KeyError):
        np.sort(std)["fx"]  # the order is another: names would be wrong
    with pytest.raises(ValueError, match="2 names"):
        Named([1.0, 2, 3], ("a", "b"))


@pytest.mark.parametrize("preset", ["auto", "paper"])
@pytest.mark.parametrize("way", COPIES)
def test_a_used_detector_can_be_copied(preset, way):
    detector = rcdn.Detector(DetectorConfig.preset(preset, threads=1))
    before = detector.detect(picture())
    after = COPIES[way](detector).detect(picture())
    assert np.array_equal(before.corners.xy, after.corners.xy)
    assert np.array_equal(before.corners.response, after.corners.response)


def test_counts_and_boards_read_as_english():
    from rcdn.errors import a_board, many

    assert [many(1, "pair"), many(2, "pair"), many(0, "view")] == ["1 pair", "2 pairs", "0 views"]
    assert [a_board(size) for size in ((9, 6), (8, 6), (11, 8), (18, 3))] == [
        "a 9×6 board", "an 8×6 board", "an 11×8 board", "an 18×3 board",
    ]  # fmt: skip
