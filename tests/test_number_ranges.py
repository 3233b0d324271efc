"""Numbers and arrays that no result could be right for: an error that names the argument or field,
and no array that fills the memory."""

import ast
import hashlib
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import rcdn
from json_edit import edit
from rcdn import Board, Camera, Corners, Detector, DetectorConfig, RcdnError, calibrate, estimate_pose
from rcdn.calibration import (
    calibrate_rig,
    calibrate_stereo,
    coverage,
    estimate_rig_pose,
    from_behind,
    projection_uncertainty,
)
from rcdn.cli import app
from rcdn.config import Adaptive, Cluster, Fixed, MaxFraction, Nms, Refine, Std
from rcdn.corners.response import load_model
from rcdn.errors import CalibrationError, ConfigError, FormatError, ImageError, present, shown
from rcdn.io import ImageResult, as_grey, read_calibration, read_camera, read_detections, write_detections, write_maps
from rcdn.io.cameras import yaml_text
from rcdn.opencv import find_chessboard_corners
from rcdn.types import Pose, Rig, RigCalibration

sys.path.append(str(Path(__file__).parent))
from test_calibration_files import calibration

PACKAGE = Path(rcdn.__file__).parent
IJ = np.array([(i, j) for j in range(3) for i in range(4)])
XY = IJ * 40.0 + [100, 80] + IJ[:, :1] * IJ[:, 1:]
BOARD = Board(XY, IJ, (640, 480), np.ones(12), np.zeros(12), "unique")
CAMERA = Camera([[600, 0, 320], [0, 600, 240], [0, 0, 1]], np.zeros(5), (640, 480))
ENDLESS = "camera.distortion: its numbers must be finite and within"
RIG = Rig(("a",), (CAMERA,), (Pose(np.eye(4)),))
GREY = cv2.resize(np.indices((7, 8)).sum(axis=0).astype(np.uint8) % 2 * 200 + 20, None, fx=20, fy=20, interpolation=0)


# ---- saved detections, calibrations and cameras


def refused(path, change, read, words):
    """A file that was written, and then changed, is refused in these words, after its name."""
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError, match=words) as caught:
        read(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("images", 0, "boards", 0, "xy", 0, value=[1e150, 3]), r"boards\[0\]: 'xy' must hold numbers within"),
        (edit("images", 0, "width", value=-5), r"images\[0\]: 'width' and 'height' must be"),
        (edit("images", 0, "width", value=10**400), r"images\[0\]: 'width' and 'height' must be"),
        (edit("images", 0, "boards", 0, "ij", 0, value=[10**15, 0]), r"'ij' must hold numbers within"),
        (edit("images", 0, "boards", 0, "ij", 0, value=[-90000, -90000]), r"Board.ij spans .* labels"),
        (edit("images", 0, "boards", 0, "ij", 0, value=[1, 0]), "twice"),
        (edit("version", value="9" * 5000), "version must be 1, not '9{59}…"),
    ],
)
def test_detections_out_of_range(tmp_path, change, words):
    path = tmp_path / "a.json"
    write_detections(path, [ImageResult("a.png", 640, 480, Corners(XY, np.ones(12), np.zeros(12)), (BOARD,))])
    refused(path, change, read_detections, words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("spacing", value=1e-300), r"'spacing' must be in \[1e-06, 1000\] m"),
        (edit("spacing", value=10**400), "'spacing' must be a finite number"),
        (edit("camera", "distortion", 0, value=1e308), "'distortion' must hold numbers within"),
        (edit("camera", "distortion", 0, value=1e90), "distortion: its numbers must be finite and within"),
        (edit("camera", "K", 0, 0, value=1e-30), "focal lengths must be"),
        (edit("camera", "image_size", value=[10**9, 5]), "'image_size' must hold two whole numbers from 1 to"),
        (edit("size", value=[10**6, 10**6]), "'size' of the board"),
        (edit("views", 0, "pose", 0, 0, value=7.0), r"views\[0\]: 'pose' is no rotation"),
        (edit("views", 0, "residuals", 1, 0, value=1e200), "'residuals' must hold numbers within"),
        (edit("cov", 0, 1, value=1e20), "'cov' must be a covariance"),
    ],
)
def test_calibrations_out_of_range(tmp_path, change, words):
    from rcdn.io import write_calibration

    path = tmp_path / "a.json"
    write_calibration(path, calibration())
    refused(path, change, read_calibration, words)


def test_aliases_say_no_more_than_a_file_can_hold():
    bomb = "a0: &a0 [0]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
    with pytest.raises(FormatError, match="aliases"):
        yaml_text.load("a.yaml", bomb)
    with pytest.raises(FormatError, match="aliases"):
        yaml_text.load("a.yaml", "&a [*a]")
    assert yaml_text.load("a.yaml", "a: &a [1]\nb: *a") == {"a": [1], "b": [1]}


@pytest.mark.parametrize(
    "text", ["image_width: 0x" + "f" * 5000, "? [1]\n: 2", "a: 1\n" * 10**6], ids=["hex", "key", "large"]
)
def test_yaml_that_is_no_camera(tmp_path, text):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(FormatError, match=re.escape(str(tmp_path))):
        read_camera(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    "text", ["[" * 10**6, "\ufeff" + "[" * 10**6, '{"version": 1, "images": ' + "[" * 10**6], ids=range(3)
)
def test_brackets(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(FormatError, match="not JSON"):
        read_detections(tmp_path / "a.json")


def test_maps_that_no_memory_holds(tmp_path):
    with pytest.raises(FormatError, match="too large"):
        write_maps(tmp_path / "a.npz", replace(CAMERA, image_size=(10**6, 10**6)))


# ---- arrays as pictures and as arguments


class Other(np.ndarray):
    pass


def variants(array):
    """The same values otherwise laid out."""
    unaligned = np.frombuffer(bytearray(1) + bytearray(array.tobytes()), array.dtype, offset=1).reshape(array.shape)
    fixed = array.copy()
    fixed.setflags(write=False)
    return {
        "unaligned": unaligned, "backwards": np.ascontiguousarray(array[::-1])[::-1],
        "columns": np.asfortranarray(array), "apart": np.repeat(array, 2, axis=0)[::2], "fixed": fixed,
        "other": array.view(Other), "masked": np.ma.array(array), "big": array.astype(array.dtype.newbyteorder(">")),
    }  # fmt: skip


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_pictures_of_any_layout(dtype):
    picture, detector = GREY.astype(dtype), Detector(DetectorConfig(threads=1))
    wanted = detector.corners(picture).xy
    assert len(wanted) > 20
    for name, same in {**variants(picture), "matrix": picture.view(np.matrix)}.items():
        np.testing.assert_array_equal(detector.corners(same).xy, wanted, err_msg=name)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (np.ma.array(GREY, mask=GREY > 100), "masked"),
        (np.broadcast_to(np.uint8(0), (10**6, 10**7)), "sides"),
        (np.broadcast_to(np.float64(0), (10**6, 10**6)), "values"),
        (np.zeros((9, 9), [("grey", "u1")]), "dtype"),
        (GREY.astype(object), "dtype"),
        (np.array(3), "shape"),
    ],
)
def test_pictures_that_are_none(picture, words):
    with pytest.raises(ImageError, match=words):
        as_grey(picture)


@pytest.mark.parametrize("name", ["xy", "ij", "response", "status"])
def test_values_of_any_layout(name):
    for same in variants(np.array(getattr(BOARD, name))).values():
        made = getattr(replace(BOARD, **{name: same}), name)
        np.testing.assert_array_equal(made, getattr(BOARD, name))
        assert made.flags.aligned
        assert type(made) is np.ndarray
        assert made.dtype.isnative


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("xy", XY + 1e150), ("xy", XY + np.inf), ("xy", XY + 0j), ("xy", XY.astype(str)), ("xy", [[1, 2], [3]]),
        ("xy", None), ("xy", np.ma.array(XY, mask=XY > 100)), ("xy", np.zeros(12, [("x", float)])),
        ("xy", np.broadcast_to(0.0, (10**12, 2))), ("xy", {}), ("ij", IJ + 0.5), ("ij", IJ + np.nan),
        ("ij", IJ * 10**15), ("ij", IJ * 90_000), ("status", np.full(12, -1)), ("status", np.full(12, 9)),
        ("status", np.full(12, 300)), ("response", ["a"] * 12), ("sigma", np.ones(5)), ("image_size", (640, -5)),
        ("image_size", (10**400, 5)), ("image_size", None), ("orientation", "up"), ("pattern", []),
        ("sigma", np.full(12, -0.1)), ("target", 3), ("target", "charuco"),
    ],
)  # fmt: skip
def test_boards_that_are_none(name, value):
    with pytest.raises(RcdnError, match=f"Board.{name}|Board.xy, ij"):
        replace(BOARD, **{name: value})


@pytest.mark.parametrize(
    "spacing", [0, -1, 1e-300, 1e300, np.nan, None, "a", 1j, 10**400, [0.02], np.array([0.02, 0.03])]
)
def test_spacing_out_of_range(spacing):
    with pytest.raises(ConfigError, match="spacing is the side"):
        calibrate([BOARD] * 3, spacing)
    if spacing is not None:  # of a pose: in sides of squares
        with pytest.raises(ConfigError, match="spacing is the side"):
            estimate_pose(BOARD, CAMERA, spacing)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: estimate_pose(None, CAMERA), "board must be a Board"),
        (lambda: estimate_pose(BOARD, None), "camera must be a Camera"),
        (lambda: estimate_pose(BOARD, CAMERA.with_parameters(CAMERA.parameters + 1e13 * (np.arange(9) > 3))), ENDLESS),
        (lambda: estimate_pose(BOARD, CAMERA.with_parameters(0 * CAMERA.parameters)), "camera.K: the focal lengths"),
        (lambda: calibrate(BOARD, 0.02), "boards must be a list"),
        (lambda: calibrate([BOARD, None], 0.02), r"boards\[1\] must be a Board"),
        (lambda: calibrate([BOARD], 0.02, size=(9,)), "size counts"),
        (lambda: calibrate([BOARD], 0.02, names=[["a"]]), "names must be a list of text"),
        (lambda: calibrate([BOARD] * 3, 0.02, names="abc"), "names must have one entry a board: 3, not 1"),
        (lambda: estimate_pose(BOARD, CAMERA, 0.02, shape="bent"), "shape must be a BoardShape"),
        (lambda: calibrate([BOARD], 0.02, fix=3), "fix must be a list of text"),
        (lambda: calibrate([BOARD], 0.02, leave_out=3), "leave_out must be a list of text"),
        (lambda: find_chessboard_corners(GREY, (9, 6.5)), "patternSize counts"),
        (lambda: find_chessboard_corners(GREY, None), "patternSize counts"),
        (lambda: Detector("paper"), "config must be a DetectorConfig"),
        (lambda: calibrate([BOARD] * 3, 0.02, flat="no"), "flat must be True or False, not 'no'"),
        (lambda: calibrate([BOARD] * 3, 0.02, flat=None), "flat must be True or False"),
        (lambda: stereo(pairs=[1, 2]), r"pairs must be a list of \(index in left, index in right\)"),
        (lambda: stereo(pairs="ab"), "pairs must be a list"),
        (lambda: stereo(pairs=3), "pairs must be a list"),
        (lambda: stereo(pairs=[(0.0, 0.0)]), "pairs must be a list"),
        (lambda: stereo(pairs=[(0, 3)]), "pairs must hold .* from 0 to 2 and 2"),
        (lambda: stereo(names=3), "names must be"),
        (
            lambda: calibrate_rig([[BOARD]] * 2, 0.02),
            "views must be a dict of lists of boards by the camera's name, not list",
        ),
        (
            lambda: calibrate_rig({0: [BOARD], 1: [BOARD]}, 0.02),
            "views: the names of cameras must be text, such as '0'",
        ),
        (lambda: rig(correct_time="no"), "correct_time must be True or False"),
        (lambda: rig(fixed_boards=1), "fixed_boards must be True or False"),
        (lambda: rig(moments=["a"]), "moments must be a dict"),
        (lambda: rig(moments={"a": 3, "b": 3}), r"moments\['a'\] must have one entry"),
        (lambda: rig(names=["a"]), "names must be a dict"),
        (lambda: rig(model=3), "model must be a dict"),
        (lambda: rig(cameras=[CAMERA]), "cameras must be a dict"),
        (lambda: rig(cameras={"a": "left.yaml"}), r"cameras\['a'\] must be a Camera"),
        (
            lambda: estimate_rig_pose({"a": BOARD}, rig_calibration()),
            "rig must be a Rig, not RigCalibration; give rig=.*rig",
        ),
        (lambda: estimate_rig_pose([BOARD], RIG), "boards must be a dict"),
        (lambda: estimate_rig_pose({"a": 3}, RIG), r"boards\['a'\] must be a Board"),
        (lambda: projection_uncertainty(CAMERA, [[1, 2]]), "calibration must be a Calibration, .* not Camera"),
        (lambda: projection_uncertainty(calibration(), "a"), "pixels must hold numbers"),
        (lambda: projection_uncertainty(calibration(), [[1, 2]], "a"), "distance must be positive"),
        (lambda: projection_uncertainty(calibration(), [[1, 2]], [1.0, 2.0]), "distance must be positive"),
        (lambda: coverage(CAMERA), "calibration must be a Calibration"),
        (lambda: coverage(calibration(), 3), "cells must be"),
        (lambda: coverage(calibration(), (0, 3)), "cells must be"),
        (lambda: from_behind(BOARD), "boards must be a list"),
        (lambda: from_behind([None]), r"boards\[0\] must be a Board"),
        (lambda: BOARD.grid_of(None), "size must be"),
        (lambda: BOARD.grid_of((9,)), "size must be"),
    ],
)
def test_arguments_of_another_kind(call, words):
    with pytest.raises(ConfigError, match=words):
        call()


def stereo(**options):
    return calibrate_stereo([BOARD] * 3, [BOARD] * 3, 0.02, **options)


def rig(**options):
    return calibrate_rig({"a": [BOARD], "b": [BOARD]}, 0.02, **options)


def rig_calibration():
    return RigCalibration(RIG, {}, {}, 0.1, (), ())


def test_numbers_of_numpy_are_taken_as_python_s():
    pairs = np.array([[0, 1], [1, 0], [2, 2]], np.uint8)
    with pytest.raises(ConfigError, match="the same boards, corner by corner"):  # after the pairs were read
        stereo(pairs=pairs)
    assert coverage(calibration(), np.array([4, 3])).shape == (3, 4)
    assert BOARD.grid_of(np.array([4, 3])).shape == (3, 4, 2)
    with pytest.raises(CalibrationError):  # too few views
        calibrate([BOARD], 0.02, flat=np.True_)


@pytest.mark.parametrize("path", [None, 3, b"a.yaml"])
def test_a_camera_is_saved_under_a_name(path):
    for format in (None, "json"):
        with pytest.raises(FormatError, match="path must be the name of a file"):
            CAMERA.save(path, format)


# ---- settings


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Nms, {"box": 100001}), (Nms, {"peaks": []}), (Nms, {"overlap": 10**400}), (Adaptive, {"level": 1e300}),
        (Fixed, {"value": -1e300}), (Std, {"factor": 10**400}), (MaxFraction, {"fraction": np.nan}),
        (Cluster, {"k": 10**9}), (Cluster, {"drop": 10**9}), (Cluster, {"least": 10**9}), (Cluster, {"seed": 2**70}),
        (Refine, {"half": 2**31}), (Refine, {"method": []}), (DetectorConfig, {"border": 1e300}),
        (DetectorConfig, {"min_corners": 10**30}), (DetectorConfig, {"threads": 10**9}),
        (DetectorConfig, {"rescue": 1}), (DetectorConfig, {"recovery": []}), (DetectorConfig, {"device": {}}),
        (DetectorConfig, {"pattern": []}),
    ],
)  # fmt: skip
def test_settings_out_of_range(kind, values):
    with pytest.raises(ConfigError, match=f"{kind.__name__}.{next(iter(values))} must be") as caught:
        kind(**values)
    assert len(str(caught.value)) < 250


def test_settings_that_are_deep():
    with pytest.raises(ConfigError, match="not JSON"):
        DetectorConfig.from_json("[" * 10**5)


# ---- networks


def network(folder, data=None, **facts):
    """A copy of the paper's network with other bytes or facts."""
    known = json.loads((PACKAGE / "weights" / "rcdn_f.json").read_text())
    data = (PACKAGE / "weights" / "rcdn_f.onnx").read_bytes() if data is None else data
    path = folder / "own.onnx"
    path.write_bytes(data)
    path.with_suffix(".json").write_text(json.dumps(known | {"sha256": hashlib.sha256(data).hexdigest()} | facts))
    return str(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("margins", 3), ("margins", [1]), ("margins", [1, 10**9]), ("margins", ["1", 2]), ("cell", 0), ("cell", None),
        ("normalisation", []), ("normalisation", "none"), ("ranges", [1]), ("ranges", [[-1.0]]),
    ],
)  # fmt: skip
def test_sidecars_out_of_range(tmp_path, name, value):
    with pytest.raises(RcdnError, match=f"own.json: '{name}' must be"):
        load_model(network(tmp_path, **{name: value}))


@pytest.mark.parametrize("text", ["", "[]", "{", "null", "[" * 10**5, '{"margins": NaN}', "\x00"], ids=range(7))
def test_sidecars_that_are_none(tmp_path, text):
    path = network(tmp_path)
    Path(path).with_suffix(".json").write_text(text)
    with pytest.raises(RcdnError, match=r"own\.json"):
        load_model(path)


@pytest.mark.parametrize("data", [b"", b"hello", b"\xff" * 99, None], ids=["empty", "text", "ones", "short"])
def test_networks_that_are_none(tmp_path, capsys, data):
    whole = (PACKAGE / "weights" / "rcdn_f.onnx").read_bytes()
    model = load_model(network(tmp_path, whole[: len(whole) // 2] if data is None else data))
    with pytest.raises(RcdnError, match=r"own\.onnx: ONNX Runtime can't load it"):
        model(GREY, 1)
    assert capsys.readouterr().out == ""


def test_networks_with_other_facts(tmp_path):
    with pytest.raises(RcdnError, match=r"own\.onnx: its response must be float32"):
        load_model(network(tmp_path, margins=[1, 2]))(GREY, 1)


def test_networks_that_are_not_finite(tmp_path):
    onnx = pytest.importorskip("onnx")
    model = onnx.load(PACKAGE / "weights" / "rcdn_f.onnx")
    first = model.graph.initializer[0]
    first.CopyFrom(onnx.numpy_helper.from_array(np.full(first.dims, np.nan, np.float32), first.name))
    with pytest.raises(RcdnError, match=r"own\.onnx: its responses are not finite"):
        load_model(network(tmp_path, model.SerializeToString()))(GREY, 1)


# ---- the command line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["board", "--size", "9x6", "--spacing", "1e-300", "-o", "a.pdf"], "--spacing"),
        (["board", "--size", "9x6", "--spacing", "1e400", "-o", "a.pdf"], "--spacing"),
        (["board", "--size", "9999x9999", "--spacing", "1mm", "-o", "a.pdf"], "--size"),
        (["board", "--size", "100000x100000", "--spacing", "1mm", "-o", "a.pdf"], "not a size"),
        (["detect", "a.png", "--threads", "-1"], "--threads"),
        (["detect", "a.png", "--jobs", "-1"], "--jobs"),
    ],
)
def test_options_out_of_range(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert not list(tmp_path.iterdir())


def test_names_that_are_no_text(tmp_path, monkeypatch):
    """A report on a picture whose name is no text is written, and so is its JSON."""
    from rcdn.io import write_text

    write_text(tmp_path / "a.html", "n\udcff\n")
    assert (tmp_path / "a.html").read_bytes() == b"n\\udcff\n"


# ---- what messages show, and guards


LONG = [10**5000, -(10**5000), "x" * 10**6, [10**5000] * 3, {"a": 10**5000}, ["\n" * 99], None]


@pytest.mark.parametrize("number", range(len(LONG)))
def test_what_a_message_shows(number):
    text = shown(LONG[number])
    assert len(text) <= 70
    assert "\n" not in text


def test_guards_hold_under_optimisation():
    found = [
        f"{path.name}:{node.lineno}"
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Assert)
    ]
    assert found == []
    assert present(0, "it") == 0
    with pytest.raises(RcdnError, match="it is missing"):
        present(None, "it")
