"""Calibrations as JSON: equal in every number after reading, plain JSON, refusals, and the cameras in them."""

import dataclasses
import json
import re

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from json_edit import edit
from rcdn.errors import FormatError
from rcdn.io import (
    read_calibration,
    read_camera,
    read_cameras,
    read_stereo,
    read_stereo_calibration,
    write_calibration,
    write_stereo,
)
from rcdn.types import (
    NOT_JUDGED,
    BoardShape,
    BoardView,
    Calibration,
    Camera,
    ModelScore,
    Pose,
    Reason,
    StereoCalibration,
    Verdict,
)

SIZE = (640, 480)
LENSES = {"pinhole": 0, "brown": 5, "rational": 8, "fisheye": 4, "division": 1}


def pose(rng):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rng.normal(size=3))[0], rng.normal(size=3)
    return T


def view(rng, name, corners=6, found=True, reason=""):
    ij = np.array([(i, j) for j in range(2) for i in range(3)])[:corners]
    residuals = rng.normal(size=(corners, 2))
    residuals[:1] = np.nan
    sigma = np.where(rng.random(corners) < 0.5, np.nan, rng.random(corners))
    used = (rng.random(corners) < 0.8) & found
    xy = rng.uniform(-0.5, 640, (corners, 2))
    where = Pose(pose(rng)) if found else None
    return BoardView(name, int(rng.integers(3)), ij, xy, sigma, where, residuals, used, reason, settled=bool(found))


def calibration(seed=0, model="brown", whole=True):
    rng = np.random.default_rng(seed)
    K = np.array([[500.1, 0.25, 320.3], [0, 501.7, 239.9], [0, 0, 1]]) * [[1], [1], [1]]
    camera = Camera(K, rng.normal(size=LENSES[model]) / 10, SIZE, model)
    many = len(camera.parameters) + 6
    A = rng.normal(size=(many, many)) * 1e-9
    views = (
        view(rng, "a.png"),
        view(rng, "größe.png", 0, False, "too few corners"),
        view(rng, "a.png", reason="blurred"),
    )
    models = (ModelScore(model, 0.1234567890123456, 0.3), ModelScore("pinhole", 3.3, float("nan")))
    return Calibration(
        camera=camera,
        spacing=0.025,
        views=views,
        cov=A @ A.T,
        noise=0.07,
        models=models if whole else (),
        size=(9, 6) if whole else None,
        orientation="unique" if whole else None,
        shape=BoardShape(rng.normal(size=(6, 9, 3)) * 1e-4) if whole else None,
        advice=("Move closer.", "Tilt the board: 20° “or more”.") if whole else (),
        verdict=verdict() if whole else NOT_JUDGED,
    )


def verdict():
    """With a value that nobody knows, and a limit without bound."""
    unknown = Reason(
        "held_out", "fair", "RMS in held-out pictures", float("nan"), 1.25, "×", "Too few.", "Take “more”."
    )
    return Verdict("fair", (unknown, Reason("corners", "good", "corners", 0.1, float("inf"), "px", "Fine.")))


def stereo(seed=0, **options):
    rng = np.random.default_rng(seed)
    T = pose(rng)
    left, right = calibration(seed + 1, **options), calibration(seed + 2, **options)
    turns = cv2.stereoRectify(
        left.camera.K, np.zeros(5), right.camera.K, np.zeros(5), SIZE, T[:3, :3], T[:3, 3:], flags=0
    )
    return StereoCalibration(
        left,
        right,
        T,
        np.eye(6) / 3,
        0.1,
        0.2,
        *turns[:5],
        advice=("Move the cameras apart.",),
        verdict=verdict(),
        pairs=2,
    )


def same(a, b):
    """Equal in type and in every number, bit for bit, NaN with NaN."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for p, q in zip(a, b, strict=True):
            same(p, q)
    else:
        assert a == b or (a != a and b != b)


def plain(path):
    """The data of strict JSON: no NaN, no Infinity."""

    def refuse(name):
        raise AssertionError(name)

    return json.loads(path.read_text("utf-8"), parse_constant=refuse)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("model", LENSES)
def test_round_trip_of_one_camera(tmp_path, model, whole):
    path = tmp_path / "a.json"
    made = calibration(3, model, whole)
    write_calibration(path, made)
    same(read_calibration(path), made)
    first = path.read_bytes()
    write_calibration(path, read_calibration(path))
    assert path.read_bytes() == first
    same(read_camera(path), made.camera)
    assert read_calibration(path).rms == made.rms


@pytest.mark.parametrize("model", LENSES)
def test_round_trip_of_two_cameras(tmp_path, model):
    path = tmp_path / "a.json"
    made = stereo(model=model)
    write_calibration(path, made)
    same(read_stereo_calibration(path), made)
    assert list(read_cameras(path)) == ["left", "right"]
    same(read_camera(path, name="right"), made.right.camera)
    pair = read_stereo(path)
    same(pair.T_right_left, made.T_right_left)
    for name in ("R_left", "R_right", "P_left", "P_right", "Q"):
        same(getattr(pair.rectification, name), getattr(made, name))


@pytest.mark.parametrize("kind", ["opencv", "ros", "kalibr", "mrcal", "json"])
def test_a_stereo_calibration_goes_into_every_format_of_pairs(tmp_path, kind):
    made = stereo(model="pinhole")
    straight = Camera(made.left.camera.K * [[1, 0, 1], [1, 1, 1], [1, 1, 1]], [], SIZE, "pinhole")
    left = dataclasses.replace(made.left, camera=straight)
    made = dataclasses.replace(made, left=left, right=left)
    back = read_stereo(*write_stereo(tmp_path / "a", made, kind))
    np.testing.assert_allclose(back.T_right_left, made.T_right_left, atol=1e-14)
    np.testing.assert_array_equal(back.left.K, straight.K)


def test_the_form_of_the_file(tmp_path):
    """One view a line; the numbers that people look for stand at the top, by name."""
    path = tmp_path / "a.json"
    made = calibration()
    write_calibration(path, made)
    data = plain(path)
    assert list(data)[:7] == ["version", "kind", "camera", "verdict", "rms", "held_out", "std"]
    assert (data["version"], data["kind"]) == (1, "calibration")
    assert data["std"] == dict(zip(made.camera.parameter_names, made.std.tolist(), strict=True))
    assert data["rms"] == made.rms
    assert sum(line.startswith('{"name"') for line in path.read_text().splitlines()) == len(made.views)
    assert data["views"][0]["residuals"][0] == [None, None]
    assert data["views"][1]["pose"] is None
    assert data["models"][1]["held_out"] is None
    write_calibration(path, stereo())
    assert plain(path)["left"]["views"][0]["name"] == "a.png"


def test_numbers_without_bound_survive(tmp_path):
    cov = np.diag(np.r_[np.inf, np.ones(14)])
    made = dataclasses.replace(calibration(), cov=cov)
    write_calibration(tmp_path / "a.json", made)
    assert plain(tmp_path / "a.json")["cov"][0][0] == "inf"
    same(read_calibration(tmp_path / "a.json"), made)


VIEW = ("views", 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("version", value=2), "version must be 1, not 2"),
        (edit("kind", value="stereo calibration"), "holds 'stereo calibration', not 'calibration'"),
        (edit("camera", value=...), "'camera' must be an object"),
        (edit("camera", "K", value=[1, 2, 3]), "camera: 'K' must hold 3 × 3 numbers"),
        (edit("camera", "model", value="omni"), "'model' must be one of"),
        (edit("spacing", value=None), "'spacing' must be a finite number"),
        (edit("noise", value=...), "'noise' must be a number or null"),
        (edit("cov", value=[[1.0]]), "'cov' must hold 15 × 15 numbers"),
        (edit("size", value=[9]), "'size' must hold 2 numbers"),
        (edit("orientation", value="upright"), "'orientation' must be null or one of unique"),
        (edit("advice", value=[3]), "'advice' must hold text"),
        (edit("verdict", value="great"), "'verdict' must be one of good, fair, unsure, bad"),
        (edit("reasons", 0, "level", value="great"), "reasons[0]: 'level' must be one of"),
        (edit("shape", value=[1, "x"]), "'shape' must hold"),
        (edit("shape", value=[[1.0, 2.0, 3.0]]), "'shape' must have shape (rows, columns, 3), not (1, 3)"),
        (edit("shape", value=[[[1.0, None, 3.0]]]), "'shape' must hold"),
        (edit("models", value={}), "'models' must be a list"),
        (edit("models", 0, "rms", value=...), "models[0]: 'rms'"),
        (edit("models", 0, value=7), "models[0] must be an object"),
        (edit("views", value=...), "'views' must be a list"),
        (edit(*VIEW, value=7), "views[0] must be an object"),
        (edit(*VIEW, "name", value=None), "views[0]: 'name' must be text"),
        (edit(*VIEW, "board", value=1.5), "'board' must be a whole number"),
        (edit(*VIEW, "xy", value=[[1, 2]]), "one row a corner"),
        (edit(*VIEW, "xy", value=[[1, 2], [3]]), "'xy' must hold numbers in rows"),
        (edit(*VIEW, "ij", 0, value=[0.5, 1]), "'ij' must hold whole numbers"),
        (edit(*VIEW, "used", 0, value=2), "'used' 0 or 1"),
        (edit(*VIEW, "settled", value="yes"), "'settled' must be true or false"),
        (edit(*VIEW, "pose", value=[[1, 2, 3, 4]]), "'pose' must hold 4 × 4 numbers"),
    ],
)
def test_wrong_forms(tmp_path, change, words):
    path = tmp_path / "a.json"
    write_calibration(path, calibration())
    data = plain(path)
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError, match=re.escape(words)) as caught:
        read_calibration(path)
    assert str(caught.value).startswith(str(path))


def test_wrong_forms_of_two_cameras(tmp_path):
    path = tmp_path / "a.json"
    for change, words in [
        (edit("left", value=...), "'left' must be an object"),
        (edit("right", "spacing", value="wide"), "right: 'spacing' must be a finite number"),
        (edit("T_right_left", value=[]), "'T_right_left' must hold 4 × 4 numbers"),
        (edit("P_left", value=np.eye(3).tolist()), "'P_left' must hold 3 × 4 numbers"),
        (edit("epipolar", value=...), "'epipolar' must be a number or null"),
    ]:
        write_calibration(path, stereo())
        data = plain(path)
        change(data)
        path.write_text(json.dumps(data))
        with pytest.raises(FormatError, match=re.escape(words)):
            read_stereo_calibration(path)
    write_calibration(path, calibration())
    with pytest.raises(FormatError, match="not 'stereo calibration'"):
        read_stereo_calibration(path)
    with pytest.raises(FormatError, match="not a pair"):
        read_stereo(path)


def test_unknown_fields_are_passed_over(tmp_path):
    path = tmp_path / "a.json"
    write_calibration(path, calibration())
    data = plain(path) | {"made by": "hand"}
    for derived in ("rms", "held_out", "std"):
        del data[derived]
    path.write_text(json.dumps(data))
    same(read_calibration(path), calibration())


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0, 1), st.integers(0, 60), st.binary(max_size=2))
def test_no_damage_gives_another_error(tmp_path, where, cut, junk):
    path = tmp_path / "a.json"
    write_calibration(path, calibration())
    data = path.read_bytes()
    start = int(where * len(data))
    path.write_bytes(data[:start] + junk + data[start + cut :])
    try:
        read_calibration(path)
    except FormatError as error:
        message = str(error)
    else:
        message = str(path)
    assert str(path) in message
