"""Kalibr's camchain: cam0, cam1, … in one YAML file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.errors import FormatError, shown
from rcdn.io.cameras.base import (
    Format,
    UnheldLensError,
    coefficients,
    make_camera,
    matrix,
    opencv_camera,
    pair_of,
    pinhole_numbers,
    unheld,
)
from rcdn.io.cameras.rig import StereoCameras
from rcdn.io.cameras.yaml_text import YAML, flow, load
from rcdn.io.fields import numbers, rigid, take, two_whole_numbers
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

TITLE = "Kalibr's camchain"
_LENGTHS = {"radtan": 4, "equidistant": 4, "none": -1}


def _lens(camera: Camera) -> tuple[str, Array]:
    d = camera.distortion
    if camera.model == "fisheye":
        return "equidistant", d
    if camera.model == "pinhole" or not d.any():
        return "radtan", np.zeros(4)
    if camera.model == "division":
        raise unheld(camera, TITLE)
    beyond = [f"{n} = {v:g}" for n, v in zip(camera.parameter_names[8:], d[4:], strict=True) if v]
    if beyond:
        raise UnheldLensError(
            f"{TITLE}: radtan holds k1 k2 p1 p2 only, but this camera has {', '.join(beyond)}; "
            "calibrate it with the model radtan or fisheye (`rcdn calibrate --model radtan`), or",
            camera.model,
        )
    return "radtan", d[:4]


def entry(camera: Camera, index: int, overlaps: Sequence[int], T: Real[Array, "4 4"] | None = None) -> str:
    """The text of camera `index`, which shares views with the cameras `overlaps`; `T` (4, 4) transforms from the frame
    of the previous camera to its own.

    Raises FormatError for a lens that a camchain can't hold."""
    kind, d = _lens(camera)
    pose = "" if T is None else "  T_cn_cnm1:\n" + "".join(f"  - {flow(row)}\n" for row in T)
    return (
        f"cam{index}:\n{pose}  cam_overlaps: {list(overlaps)}\n  camera_model: pinhole\n"
        f"  distortion_coeffs: {flow(d)}\n  distortion_model: {kind}\n"
        f"  intrinsics: {flow(pinhole_numbers(camera, TITLE))}\n"
        f"  resolution: [{camera.image_size[0]}, {camera.image_size[1]}]\n  rostopic: /cam{index}/image_raw\n"
    )


def _stereo_texts(pair: StereoCameras) -> tuple[str, ...]:
    return (entry(pair.left, 0, [1]) + entry(pair.right, 1, [0], pair.T_right_left),)


def names(data: Any) -> list[str]:
    """Names of the cameras in a camchain, in numerical order."""
    found = (
        [k for k in data if isinstance(k, str) and re.fullmatch(r"cam[0-9]{1,9}", k)] if isinstance(data, dict) else []
    )
    return sorted(found, key=lambda name: int(name[3:]))


def _camera(record: Any, where: str) -> Camera:
    kind, lens = take(record, "camera_model", str, where), take(record, "distortion_model", str, where)
    if kind != "pinhole":
        raise FormatError(
            f"{where}: 'camera_model' must be pinhole, not {shown(kind)}, which rcdn doesn't know; calibrate again"
        )
    if lens not in _LENGTHS:
        raise FormatError(
            f"{where}: 'distortion_model' must be one of {', '.join(_LENGTHS)}, not {shown(lens)}; calibrate again"
        )
    K = matrix(*numbers(record, "intrinsics", where, finite=True, shape=(4,)))
    size = two_whole_numbers(record, "resolution", where)
    if lens == "none":
        return make_camera(where, K, [], size, "pinhole")
    d = numbers(record, "distortion_coeffs", where, finite=True, shape=(_LENGTHS[lens],))
    return opencv_camera(where, K, d, size, fisheye=lens == "equidistant")


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    if not names(data):
        raise FormatError(f"{path}: has no 'cam0'; give a camchain of Kalibr")
    return {name: _camera(data[name], f"{path}: {name}") for name in names(data)}


def _stereo(files: Sequence[tuple[Any, str]]) -> StereoCameras:
    data, path = files[0]
    if len(files) > 1:
        raise FormatError(f"{files[1][1]}: {TITLE} holds both cameras in one file; give that one only")
    left, right = pair_of(_cameras(data, path), path)
    second = names(data)[1]
    T = rigid(data[second], "T_cn_cnm1", f"{path}: {second}")
    return StereoCameras(left, right, T)


_FIT = coefficients(("brown", 4), ("fisheye", 4))
FORMAT = Format(
    TITLE,
    load,
    _cameras,
    lambda camera: entry(camera, 0, []),
    YAML,
    ("pinhole", "fisheye"),
    _stereo_texts,
    _stereo,
    _FIT,
    mark="camchain",
    recognised_yaml=lambda data: bool(names(data)),
    parts=lambda data: {name: {name: data[name]} for name in names(data)},
)
