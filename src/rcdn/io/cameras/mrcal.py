"""mrcal's .cameramodel, one camera per file; a pair is two files whose reference frame is that of the left camera."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from rcdn.errors import FormatError, RcdnError, shown
from rcdn.geometry.rigid import motion, rotation_vector
from rcdn.geometry.splined import Splined, camera_of, splined_of
from rcdn.io.cameras.base import Format, LensFit, make_camera, matrix, opencv_camera, pinhole_numbers, unheld
from rcdn.io.cameras.rig import StereoCameras
from rcdn.io.cameras.yaml_text import flow
from rcdn.io.fields import numbers, take, two_whole_numbers
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

TITLE = "mrcal's .cameramodel"
_LENGTHS = {
    f"LENSMODEL_{name}": n
    for name, n in {"PINHOLE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}.items()
}
_NAMES = {n: name for name, n in _LENGTHS.items()}
SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC"
_SPLINED = re.compile(SPLINED + r"_order=(\d{1,9})_Nx=(\d{1,9})_Ny=(\d{1,9})_fov_x_deg=(\d{1,9})")
_POSE = ("extrinsics", "rt_cam_ref")


def _file(camera: Camera | Splined, rt: Array) -> str:
    name, numbers, order = _splined_lens(camera) if isinstance(camera, Splined) else _lens(camera)
    width, height = camera.image_size
    return (
        f"{{\n    'lensmodel':  '{name}',\n\n"
        f"    # fx,fy,cx,cy, then {order}\n"
        f"    'intrinsics': {flow(numbers)},\n\n"
        f"    # rt_fromref: rotation vector and translation of the reference in this camera, m\n"
        f"    'extrinsics': {flow(rt)},\n\n"
        f"    'imagersize': [{width}, {height}],\n}}\n"
    )


def _lens(camera: Camera) -> tuple[str, list[float], str]:
    """Name of the lens model, its parameters, and a description of those after the first four."""
    core = pinhole_numbers(camera, TITLE)
    if camera.model in ("fisheye", "division"):
        raise unheld(camera, TITLE)
    return _NAMES[len(camera.distortion)], [*core, *camera.distortion], "the distortion in OpenCV's order"


def _splined_lens(camera: Splined) -> tuple[str, list[float], str]:
    rows, columns, _ = camera.control.shape
    name = f"{SPLINED}_order=3_Nx={columns}_Ny={rows}_fov_x_deg={camera.fov}"
    return name, [*camera.core, *camera.control.ravel()], "the spline's control points, row by row, x before y"


def _fit(camera: Camera) -> LensFit:
    held, rms, largest = splined_of(camera)
    return LensFit(held, SPLINED, rms, largest)


def _stereo_texts(pair: StereoCameras) -> tuple[str, ...]:
    T = pair.T_right_left
    rt = np.concatenate([rotation_vector(T[:3, :3]), T[:3, 3]])
    return _file(pair.left, np.zeros(6)), _file(pair.right, rt)


def _load(path: str, text: str) -> Any:
    try:
        return ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise FormatError(f"{path}: not a .cameramodel ({shown(str(error))}); export it again") from error


def _camera(data: Any, path: str) -> Camera:
    name = take(data, "lensmodel", str, path)
    if splined := _SPLINED.fullmatch(name):
        return _splined_camera(data, path, [int(n) for n in splined.groups()])
    if name not in _LENGTHS:
        raise FormatError(
            f"{path}: rcdn doesn't know the lens model {shown(name)}; make it one of {', '.join(_LENGTHS)} or "
            f"{SPLINED}_order=3_… with mrcal-convert-lensmodel"
        )
    values, size = _numbers(data, path, 4 + _LENGTHS[name])
    return opencv_camera(path, matrix(*values[:4]), values[4:], size)


def _numbers(data: Any, path: str, many: int) -> tuple[Array, tuple[int, int]]:
    """The intrinsics (many,) and the image size (width, height)."""
    data = {k: list(v) if isinstance(v, tuple) else v for k, v in data.items()}
    values = numbers(data, "intrinsics", path, finite=True, shape=(many,))
    return values, two_whole_numbers(data, "imagersize", path)


def _splined_camera(data: Any, path: str, numbers_of_name: list[int]) -> Camera:
    order, columns, rows, fov = numbers_of_name
    if order != 3 or min(columns, rows) < 4:
        raise FormatError(
            f"{path}: rcdn reads splines of order 3 with Nx and Ny of 4 or more only; calibrate with those"
        )
    values, size = _numbers(data, path, 4 + 2 * rows * columns)
    make_camera(path, matrix(*values[:4]), [], size, "pinhole")  # only for its checks
    try:
        return camera_of(Splined(values[:4], values[4:].reshape(rows, columns, 2), fov, size))
    except RcdnError as error:
        raise FormatError(f"{path}: {error}") from error


def _pose(data: Any, path: str) -> Real[Array, "4 4"]:
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


def _text(camera: Camera | Splined) -> str:
    return _file(camera, np.zeros(6))


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    return {"camera": _camera(data, path)}


FORMAT = Format(
    TITLE,
    _load,
    _cameras,
    _text,
    (".cameramodel",),
    ("pinhole", "brown", "rational"),
    _stereo_texts,
    _stereo,
    _fit,
    head="{\n",
    recognised=lambda first, text: first.startswith("{") and "lensmodel" in text,
    pair_files=2,
)
