"""rcdn's JSON of a camera or a pair: all lens models, all digits. A complete calibration (rcdn.io.calibration) has the
same fields, and more."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from rcdn.errors import FormatError, shown
from rcdn.io.cameras.base import Format, make_camera, pair_of, usable
from rcdn.io.cameras.rig import Rectification, StereoCameras
from rcdn.io.fields import located, numbers, read_json, rigid, take, two_whole_numbers
from rcdn.types import Camera, CameraModel, LensCorrection

TITLE = "rcdn's JSON"
VERSION = 1
SHAPES = {"R_left": (3, 3), "R_right": (3, 3), "P_left": (3, 4), "P_right": (3, 4), "Q": (4, 4)}
_BLOCKS = ("left", "right")


def camera_record(camera: Camera) -> dict[str, Any]:
    """The fields of a camera."""
    if not np.isfinite(camera.distortion).all():
        raise FormatError(
            f"{TITLE}: Camera.distortion must be finite, not {camera.distortion.tolist()}; calibrate again"
        )
    record = {
        "model": camera.model,
        "image_size": [int(n) for n in camera.image_size],
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
    }
    if (correction := camera.correction) is not None:
        if not np.isfinite(correction.control).all():
            raise FormatError(f"{TITLE}: Camera.correction must have finite control points; calibrate again")
        record["correction"] = {"extent": correction.extent.tolist(), "control": correction.control.tolist()}
    return record


def camera_of(owner: Any, where: str) -> Camera:
    """The camera of `owner["camera"]`."""
    record = take(owner, "camera", dict, where)
    where = f"{where}: camera"
    model: CameraModel = take(record, "model", str, where)
    if model not in get_args(CameraModel):
        raise FormatError(f"{where}: 'model' must be one of {', '.join(get_args(CameraModel))}, not {shown(model)}")
    size = two_whole_numbers(record, "image_size", where)
    K = numbers(record, "K", where, finite=True, shape=(3, 3))
    camera = make_camera(where, K, numbers(record, "distortion", where, finite=True, shape=(-1,)), size, model)
    return camera if record.get("correction") is None else _corrected(camera, record, where)


def _corrected(camera: Camera, record: dict[str, Any], where: str) -> Camera:
    found = take(record, "correction", dict, where)
    where = f"{where}: correction"
    extent = numbers(found, "extent", where, finite=True, shape=(2,))
    control = numbers(found, "control", where, finite=True)
    with located(where):
        corrected = replace(camera, correction=LensCorrection(control, extent))
    return usable(corrected, where)


def to_text(kind: str, record: dict[str, Any]) -> str:
    """The text of a JSON file: one field per line, and one view per line."""
    return _block({"version": VERSION, "kind": kind, **record}) + "\n"


def load(path: str, text: str) -> Any:
    """The data of a file. Raises FormatError if it isn't JSON of a version that can be read."""
    data = read_json(path, text, "write it with `rcdn calibrate --json`")
    version = data.get("version") if isinstance(data, dict) else None
    if version is None:
        raise FormatError(f"{path}: JSON, but not of rcdn; of OpenCV's FileStorage the YAML is read: save a .yaml")
    if version != VERSION:
        raise FormatError(
            f"{path}: version must be {VERSION}, not {shown(version)}; write it again with `rcdn calibrate --json`"
        )
    return data


def cameras(data: Any, path: str) -> dict[str, Camera]:
    """The cameras by name, of a file of a camera, a pair, a rig, or a calibration of any of them."""
    if "camera" in data:
        return {"camera": camera_of(data, path)}
    if data.get("kind") == "rig":
        records = [(f"{path}: cameras[{k}]", r) for k, r in enumerate(take(data, "cameras", list, path))]
        return {take(record, "name", str, where): camera_of(record, where) for where, record in records}
    if all(side in data for side in _BLOCKS):
        return {side: camera_of(data[side], f"{path}: {side}") for side in _BLOCKS}
    raise FormatError(f"{path}: holds no camera; give a file of `rcdn calibrate`")


def _text(camera: Camera) -> str:
    return to_text("camera", {"camera": camera_record(camera)})


def _stereo_texts(found: StereoCameras) -> tuple[str, ...]:
    sides = {side: {"camera": camera_record(getattr(found, side))} for side in _BLOCKS}
    turns = {name: getattr(found.rectification, name).tolist() for name in SHAPES if found.rectification}
    return (to_text("stereo cameras", {"T_right_left": found.T_right_left.tolist(), **turns, **sides}),)


def _stereo(files: Sequence[tuple[Any, str]]) -> StereoCameras:
    if len(files) > 1:
        raise FormatError(f"{files[1][1]}: {TITLE} holds both cameras in one file; give that one only")
    return _pair(*files[0])


def _pair(data: Any, path: str) -> StereoCameras:
    """The pair in a file of stereo cameras or of a stereo calibration."""
    left, right = pair_of(cameras(data, path), path)
    T = rigid(data, "T_right_left", path)
    if "R_left" not in data:
        return StereoCameras(left, right, T)
    turns = {name: numbers(data, name, path, finite=True, shape=shape) for name, shape in SHAPES.items()}
    return StereoCameras(left, right, T, Rectification(**turns))


def _block(record: dict[str, Any]) -> str:
    return "{\n" + ",\n".join(f"{json.dumps(key)}: {_value(key, value)}" for key, value in record.items()) + "\n}"


def _value(key: str, value: Any) -> str:
    if key in _BLOCKS:
        return _block(value)
    if key == "views" and value:
        return "[\n" + ",\n".join(json.dumps(v, allow_nan=False) for v in value) + "\n]"
    return json.dumps(value, allow_nan=False)


FORMAT = Format(
    TITLE,
    load,
    cameras,
    _text,
    (".json",),
    get_args(CameraModel),
    _stereo_texts,
    _stereo,
    recognised=lambda first, _: first.startswith("{"),
    rectified=True,
)
