"""Camera files that are broken, of another kind or damaged: a FormatError that names the file and the fix."""

import re

import pytest
from camera_files import FORMATS, camera
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rcdn.errors import FormatError
from rcdn.io import (
    read_camera,
    read_stereo,
    write_camera,
)


def swap(old, new):
    return lambda text: re.sub(old, new, text, flags=re.S)


@pytest.mark.parametrize(
    ("kind", "lens", "change", "words"),
    [
        ("opencv", "brown5", swap("image_width: 1280\n", ""), "'image_width'.*add the size"),
        ("opencv", "brown5", swap("1280", "0"), "image size must be|two whole numbers from 1 to"),
        ("opencv", "brown5", swap("1280", "12.5"), "'image_width' must be a whole number"),
        ("opencv", "brown5", swap("rows: 3", "rows: 4"), "must have rows, cols and as many numbers"),
        (
            "opencv",
            "brown5",
            swap("rows: 3\n   cols: 3", "rows: 9\n   cols: 1"),
            "'camera_matrix' must be a 3 × 3 matrix",
        ),
        ("opencv", "brown5", swap("812.3456789012345", "0"), "calibrated camera"),
        ("opencv", "brown5", swap("812.3456789012345", ".nan"), "calibrated camera"),
        ("opencv", "brown5", swap("0.003", ".inf"), "finite"),
        ("opencv", "brown5", swap("distortion_coefficients.*", ""), "'distortion_coefficients' must be"),
        ("opencv", "brown4", swap("fisheye_model: 0\n", ""), "add `fisheye_model: 0`"),
        ("opencv", "brown4", swap("0.02,", ""), "must have rows, cols and as many numbers"),
        ("opencv", "brown4", swap("rows: 4", "rows: 3"), "must have rows, cols and as many numbers"),
        ("ros", "brown5", swap("plumb_bob", "thin_prism"), "'distortion_model' must be one of plumb_bob"),
        ("ros", "brown5", swap("plumb_bob", "equidistant"), "equidistant takes 4 numbers, not 5"),
        ("ros", "brown5", swap("812.3456789012345", "0"), "calibrated camera"),
        ("ros", "brown5", swap("812.3456789012345", "wide"), "must hold numbers"),
        ("ros", "brown5", swap("0.003", "[0.003]"), "distortion_coefficients: 'data' must hold any numbers"),
        ("ros", "brown5", swap("641.1,", ""), "camera_matrix: 'data' must hold 9 numbers"),
        ("ros", "brown5", swap("image_height", "height"), "'image_height'.*add the size"),
        ("kalibr", "brown4", swap("pinhole", "omni"), "cam0: 'camera_model' must be pinhole, not 'omni'"),
        ("kalibr", "brown4", swap("radtan", "fov"), "'distortion_model' must be one of radtan"),
        ("kalibr", "brown4", swap("radtan", "[]"), "'distortion_model' must be text"),
        ("kalibr", "brown4", swap(", -0.001", ""), "'distortion_coeffs' must hold 4 numbers"),
        ("kalibr", "brown4", swap("resolution", "size"), "'resolution' must be a list"),
        ("kalibr", "brown4", swap("1280", "1e300"), "'resolution' must hold two whole numbers"),
        ("kalibr", "brown4", swap("1280", "12.5"), "'resolution' must hold two whole numbers"),
        ("kalibr", "brown4", swap("cam0:.*", "cam0: 3"), "cam0 must be an object"),
        ("colmap", "brown4", swap(" 0.02", ""), "line 4: OPENCV takes 8 numbers, not 7"),
        ("colmap", "brown4", swap("OPENCV", "FOV"), "doesn't know the lens model 'FOV'"),
        ("colmap", "brown4", swap("0.02", "e"), "PARAMS"),
        ("colmap", "brown4", swap("0.02", "x"), "line 4 must be `CAMERA_ID"),
        ("mrcal", "brown4", swap(", 0.02", ""), "'intrinsics' must hold 8 numbers"),
        ("mrcal", "brown4", swap("OPENCV4", "CAHVOR"), "convert-lensmodel"),
        ("mrcal", "brown4", swap("\\[1280, 720\\]", "1280"), "'imagersize' must be a list"),
        ("mrcal", "brown4", swap("'imagersize'", "'size'"), "'imagersize' must be a list"),
        ("mrcal", "brown4", swap("\\[1280", "open([1280"), "not a .cameramodel"),
        ("json", "brown4", swap('"version": 1', '"version": 2'), "version must be 1, not 2"),
        ("json", "brown4", swap("brown", "radtan"), "'model' must be one of pinhole, brown"),
        ("json", "brown4", swap("brown", "rational"), "takes 8 numbers, not 4"),
        ("json", "brown4", swap("0.02", "null"), "'distortion' must hold finite numbers"),
        ("json", "brown4", swap('"camera"', '"images"'), "holds no camera"),
        ("json", "brown4", swap("1280", "-1280"), "image size must be|two whole numbers from 1 to"),
        ("json", "brown4", swap("0.02,", ""), "takes 4 or 5 numbers, not 3"),
    ],
)
def test_broken_files(tmp_path, kind, lens, change, words):
    path = tmp_path / "a"
    write_camera(path, camera(lens), kind)
    text = path.read_text()
    assert change(text) != text
    path.write_text(change(text))
    with pytest.raises(FormatError, match=words) as caught:
        read_camera(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no camera file that rcdn knows"),
        (b"\n\n\n# only this\n", "no camera file that rcdn knows"),
        (b"hello", "no camera file that rcdn knows"),
        (b"[1, 2]", "no camera file that rcdn knows"),
        (b"a: 1", "no camera file that rcdn knows"),
        (b"a: [1", "not YAML .*line 1"),
        (b"a: 2001-99-99", "not YAML"),
        (b"? {a: [1]}\n: 2", "not YAML"),
        (b"a: !!python/object/apply:os.getcwd []", "not YAML"),
        (b"[" * 1500, "not YAML"),
        (b"{", "not JSON"),
        (b'{"lensmodel": ' + b"[" * 5000, "not a .cameramodel"),
        (b'{"version": 1, "images": [], "errors": []}', "holds no camera"),
        (b"\n" * 5000 + b"1 PINHOLE 64 48 1 1", "PINHOLE takes 4 numbers"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "not a text file"),
        (b"%YAML:1.0\n---\nM1: 3\nimage_width: 3\nimage_height: 4\n", "'M1' must be a 3 × 3 matrix"),
    ],
)
def test_files_that_are_no_camera(tmp_path, content, words):
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(FormatError, match=words):
        read_camera(tmp_path / "a.yaml")


def test_a_wrong_format_is_told_not_guessed(tmp_path):
    for kind in FORMATS:
        write_camera(tmp_path / kind, camera("brown4"), kind)
    for kind in FORMATS:
        for other in FORMATS:
            if kind != other:
                with pytest.raises(FormatError):
                    read_camera(tmp_path / kind, other)
    for read in (read_camera, read_stereo):
        with pytest.raises(FormatError, match="no such file"):
            read(tmp_path / "none")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(FORMATS), st.floats(0, 1), st.floats(0, 1), st.binary(max_size=3))
def test_no_damage_gives_another_error(tmp_path, kind, where, cut, junk):
    """A file with a piece taken out and junk put in is a camera or a FormatError."""
    path = tmp_path / "a"
    write_camera(path, camera("brown4"), kind)
    data = path.read_bytes()
    start = int(where * len(data))
    path.write_bytes(data[:start] + junk + data[start + int(cut * 40) :])
    for format in (None, kind):
        try:
            read_camera(path, format)
        except FormatError as error:
            message = str(error)
        else:
            message = str(path)
        assert str(path) in message
