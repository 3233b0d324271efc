"""mrcal's .cameramodel, one camera a file; a pair is two files whose reference is the left camera."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from rcdn.errors import FormatError
from rcdn.io.cameras.base import Format, make_camera, matrix, opencv_lens, pinhole_numbers, unheld
from rcdn.io.cameras.rig import StereoCameras, motion
from rcdn.io.cameras.yaml_text import flow
from rcdn.io.fields import numbers, take, two_whole_numbers
from rcdn.types import Array, Camera

TITLE = "mrcal's .cameramodel"
_LENGTHS = {
    f"LENSMODEL_{name}": n
    for name, n in {"PINHOLE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}.items()
}
_NAMES = {n: name for name, n in _LENGTHS.items()}
_POSE = ("extrinsics", "rt_cam_ref")


def _file(camera: Camera, rt: Array) -> str:
    core = pinhole_numbers(camera, TITLE)
    if camera.model in ("fisheye", "division"):
        raise unheld(camera, TITLE)
    width, height = camera.image_size
    return (
        f"{{\n    'lensmodel':  '{_NAMES[len(camera.distortion)]}',\n\n"
        f"    # fx,fy,cx,cy, then the distortion in OpenCV's order\n"
        f"    'intrinsics': {flow([*core, *camera.distortion])},\n\n"
        f"    # rt_fromref: rotation vector and translation of the reference in this camera, m\n"
        f"    'extrinsics': {flow(rt)},\n\n"
        f"    'imagersize': [{width}, {height}],\n}}\n"
    )


def _stereo_texts(pair: StereoCameras) -> tuple[str, ...]:
    T = pair.T_right_left
    rt = np.concatenate([_rotation_vector(T[:3, :3]), T[:3, 3]])
    return _file(pair.left, np.zeros(6)), _file(pair.right, rt)


def _rotation_vector(R: Array) -> Array:
    """(3,) of a rotation (3, 3): exact near no turn and near half a turn, where cv2.Rodrigues isn't."""
    a, b, c = R
    # the quaternion (x, y, z, w) is the eigenvector of the largest eigenvalue
    K = np.array([
        [a[0] - b[1] - c[2], b[0] + a[1], c[0] + a[2], c[1] - b[2]],
        [b[0] + a[1], b[1] - a[0] - c[2], c[1] + b[2], a[2] - c[0]],
        [c[0] + a[2], c[1] + b[2], c[2] - a[0] - b[1], b[0] - a[1]],
        [c[1] - b[2], a[2] - c[0], b[0] - a[1], a[0] + b[1] + c[2]],
    ])  # fmt: skip
    q = np.linalg.eigh(K)[1][:, -1]
    axis, w = q[:3] * np.copysign(1, q[3]), abs(q[3])
    length = np.linalg.norm(axis)
    return np.asarray(axis * (2 * np.arctan2(length, w) / length if length else 0))


def _load(path: str, text: str) -> Any:
    try:
        return ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise FormatError(f"{path}: not a .cameramodel ({error}); export it again") from error


def _camera(data: Any, path: str) -> Camera:
    name = take(data, "lensmodel", str, path)
    if name not in _LENGTHS:
        raise FormatError(
            f"{path}: rcdn doesn't know the lens model {name}; make it one of {', '.join(_LENGTHS)} with mrcal-convert-lensmodel"
        )
    data = {k: list(v) if isinstance(v, tuple) else v for k, v in data.items()}
    values = numbers(data, "intrinsics", path, finite=True, shape=(4 + _LENGTHS[name],))
    size = two_whole_numbers(data, "imagersize", path)
    model, distortion = opencv_lens(path, values[4:])
    return make_camera(path, matrix(*values[:4]), distortion, size, model)


def _pose(data: Any, path: str) -> Array:
    """T_cam_ref (4, 4)."""
    key = next((k for k in _POSE if k in data), _POSE[0])
    rt = numbers({key: list(data.get(key, ()))}, key, path, finite=True, shape=(6,))
    return motion(cv2.Rodrigues(rt[:3])[0], rt[3:])


def _stereo(files: Sequence[tuple[Any, str]]) -> StereoCameras:
    if len(files) != 2:
        raise FormatError(f"{files[0][1]}: {TITLE} holds one camera a file; give the right camera's, too")
    left, right = (_camera(data, path) for data, path in files)
    T_left_ref, T_right_ref = (_pose(data, path) for data, path in files)
    return StereoCameras(left, right, T_right_ref @ np.linalg.inv(T_left_ref))


def _text(camera: Camera) -> str:
    return _file(camera, np.zeros(6))


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    return {"camera": _camera(data, path)}


FORMAT = Format(TITLE, _load, _cameras, _text, _stereo_texts, _stereo)
