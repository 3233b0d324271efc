"""OpenCV's YAML, as written and read by cv2.FileStorage and OpenCV's calibration samples; its XML is read, too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.errors import FormatError
from rcdn.geometry.rigid import motion
from rcdn.io.cameras import xml_text, yaml_text
from rcdn.io.cameras.base import (
    Format,
    coefficients,
    opencv_camera,
    pair_of,
    pinhole_numbers,
    size_of,
    unheld,
)
from rcdn.io.cameras.rig import Rectification, StereoCameras
from rcdn.io.cameras.yaml_text import YAML, Matrix, block_matrix
from rcdn.io.fields import number
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

TITLE = "OpenCV's YAML"
_TURNS = ("R1", "R2", "P1", "P2", "Q")
_FLAG = "fisheye_model"
_FLAGS = (f"{_FLAG}_1", f"{_FLAG}_2")


def _matrix(key: str, array: Array) -> str:
    return block_matrix(key, array, " !!opencv-matrix")


def _lens(camera: Camera) -> Real[Array, "n 1"]:
    """Distortion (N, 1); five zeros for a pinhole, as OpenCV's programs expect."""
    pinhole_numbers(camera, TITLE)
    if camera.model == "division":
        raise unheld(camera, TITLE)
    return (np.zeros(5) if camera.model == "pinhole" else camera.distortion)[:, None]


def _head(camera: Camera, other: Camera | None = None) -> str:
    """Picture size and lens flag. If only one camera of a pair is a fisheye, each has a flag of its own, so that no
    reader applies a single flag to both."""
    width, height = camera.image_size
    flags = [int(c.model == "fisheye") for c in (camera, other or camera)]
    names = (_FLAG,) if flags[0] == flags[1] else _FLAGS
    lens = "".join(f"{name}: {flag}\n" for name, flag in zip(names, flags, strict=False))
    return f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n{lens}"


def _text(camera: Camera) -> str:
    return _head(camera) + _matrix("camera_matrix", camera.K) + _matrix("distortion_coefficients", _lens(camera))


def _stereo_texts(pair: StereoCameras) -> tuple[str, ...]:
    left, right = pair.left, pair.right
    text = _head(left, right)
    if right.image_size != left.image_size:
        text += "image_width_2: {}\nimage_height_2: {}\n".format(*right.image_size)
    matrices = {"M1": left.K, "D1": _lens(left), "M2": right.K, "D2": _lens(right)}
    matrices |= {"R": pair.T_right_left[:3, :3], "T": pair.T_right_left[:3, 3:]}
    if turns := pair.rectification:
        matrices |= dict(zip(_TURNS, (turns.R_left, turns.R_right, turns.P_left, turns.P_right, turns.Q), strict=True))
    return (text + "".join(_matrix(key, array) for key, array in matrices.items()),)


def _get(data: dict[str, Any], key: str, shape: tuple[int, int] | None, where: str) -> Array:
    """The matrix of `key` in any case (older samples write Camera_Matrix)."""
    value = data.get(key.lower())
    array = value.array(f"{where}: {key!r}") if isinstance(value, Matrix) else None
    if array is None or (shape and array.shape != shape):
        size = "{} × {}".format(*shape) if shape else "row or column"
        raise FormatError(f"{where}: {key!r} must be a {size} matrix (!!opencv-matrix)")
    return array


def _camera(
    data: dict[str, Any], keys: tuple[str, str], size: tuple[int, int], where: str, own_flag: str = _FLAG
) -> Camera:
    """The camera from the `keys` of the camera matrix and the distortion; the lens flag is `own_flag` if present, else
    the common one."""
    K, values = _get(data, keys[0], (3, 3), where), _get(data, keys[1], None, where).ravel()
    where = f"{where}: {keys[1]!r}"
    flag = own_flag if own_flag in data else _FLAG
    if flag not in data and len(values) == 4:
        raise FormatError(
            f"{where} has 4 numbers, which a plain and a fisheye lens can have; add `{_FLAG}: 0` (or 1) to the file"
        )
    return opencv_camera(where, K, values, size, fisheye=flag in data and bool(number(data, flag, where)))


def _load(path: str, text: str) -> Any:
    return xml_text.load(path, text) if xml_text.is_xml(text) else yaml_text.load(path, text)


def _lower(data: Any) -> dict[str, Any]:
    return {str(key).lower(): value for key, value in data.items()} if isinstance(data, dict) else {}


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    data = _lower(data)
    size = size_of(data, "image_width", "image_height", path)
    if "m1" not in data:
        return {"camera": _camera(data, ("camera_matrix", "distortion_coefficients"), size, path)}
    other = size_of(data, "image_width_2", "image_height_2", path) if "image_width_2" in data else size
    return {
        "left": _camera(data, ("M1", "D1"), size, path, _FLAGS[0]),
        "right": _camera(data, ("M2", "D2"), other, path, _FLAGS[1]),
    }


def _stereo(files: Sequence[tuple[Any, str]]) -> StereoCameras:
    """The pair in one file, or in intrinsics.yml and extrinsics.yml of OpenCV's stereo sample."""
    path = " and ".join(name for _, name in files)
    data = {key: value for part, _ in files for key, value in _lower(part).items()}
    left, right = pair_of(_cameras(data, path), path)
    T = motion(_get(data, "R", (3, 3), path), _get(data, "T", (3, 1), path))
    if "r1" not in data:
        return StereoCameras(left, right, T)
    R1, R2 = (_get(data, key, (3, 3), path) for key in ("R1", "R2"))
    P1, P2 = (_get(data, key, (3, 4), path) for key in ("P1", "P2"))
    return StereoCameras(left, right, T, Rectification(R1, R2, P1, P2, _get(data, "Q", (4, 4), path)))


_FIT = coefficients(("brown", 5), ("rational", 8), ("fisheye", 4))
FORMAT = Format(
    TITLE,
    _load,
    _cameras,
    _text,
    YAML,
    ("pinhole", "brown", "rational", "fisheye"),
    _stereo_texts,
    _stereo,
    _FIT,
    head="---\n",
    recognised=lambda _, text: xml_text.is_xml(text),
    recognised_yaml=lambda data: bool({"camera_matrix", "m1", "r"} & set(_lower(data))),
    rectified=True,
)
