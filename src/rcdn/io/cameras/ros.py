"""ROS camera_info YAML, one camera per file, and CameraInfo messages as `ros2 topic echo --once` prints; the relative
pose of a pair is computed from the rectification of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rcdn.errors import FormatError, shown
from rcdn.geometry.rigid import motion
from rcdn.io.cameras.base import Format, coefficients, one_of, opencv_camera, pinhole_numbers, size_of, unheld
from rcdn.io.cameras.rig import Rectification, StereoCameras
from rcdn.io.cameras.yaml_text import YAML, Matrix, block_matrix, load
from rcdn.io.fields import numbers, take
from rcdn.types import Array, Camera

TITLE = "ROS camera_info"
_NAMES = {"pinhole": "plumb_bob", "brown": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
_MESSAGE = {"k": "camera_matrix", "d": "distortion_coefficients", "r": "rectification_matrix", "p": "projection_matrix"}
"""fields of a message, in capitals in ROS 1, and the matrices of a file"""
_REGION = ("x_offset", "y_offset", "width", "height")
_LENGTHS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}


def _file(camera: Camera, name: str, R: Array, P: Array) -> str:
    pinhole_numbers(camera, TITLE)
    if camera.model not in _NAMES:
        raise unheld(camera, TITLE)
    D = camera.distortion
    if _NAMES[camera.model] == "plumb_bob":
        D = np.concatenate([D, np.zeros(5 - len(D))])  # ROS requires all five
    width, height = camera.image_size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n"
        + block_matrix("camera_matrix", camera.K)
        + f"distortion_model: {_NAMES[camera.model]}\n"
        + block_matrix("distortion_coefficients", D)
        + block_matrix("rectification_matrix", R)
        + block_matrix("projection_matrix", P)
    )


def _text(camera: Camera) -> str:
    return _file(camera, "camera", np.eye(3), np.concatenate([camera.K, np.zeros((3, 1))], axis=1))


def _stereo_texts(pair: StereoCameras) -> tuple[str, ...]:
    turns = pair.turns
    left = _file(pair.left, "left", turns.R_left, turns.P_left)
    return left, _file(pair.right, "right", turns.R_right, turns.P_right)


def _is_message(data: Any) -> bool:
    names = {str(name).lower() for name in data} if isinstance(data, dict) else set()
    return {"width", "height", "distortion_model", *_MESSAGE} <= names


def _as_file(data: Any, path: str) -> Any:
    """The data of a file; a message's in the form of a file's. Raises FormatError for a message of pictures that are
    binned or cropped."""
    if not _is_message(data):
        return data
    fields = {str(name).lower(): value for name, value in data.items()}
    if smaller := [*_binned(fields), *_cropped(fields)]:
        raise FormatError(
            f"{path}: by this message pictures are {' and '.join(smaller)}, but K is of the whole "
            f"{fields['width']}×{fields['height']} px; for a camera of whole pictures set binning_x, binning_y and all "
            "of roi to 0 in the file, for one of smaller pictures calibrate with those"
        )
    matrices = {name: {"data": fields[field]} for field, name in _MESSAGE.items()}
    sides = {f"image_{side}": fields[side] for side in ("width", "height")}
    return {**sides, "distortion_model": fields["distortion_model"], **matrices}


def _binned(fields: Mapping[str, Any]) -> list[str]:
    """How pictures are binned, in words; [] if they aren't."""
    binning = [fields.get(f"binning_{axis}") or 1 for axis in "xy"]  # 0 is 1
    return [] if binning == [1, 1] else ["binned by {} × {}".format(*binning)]


def _cropped(fields: Mapping[str, Any]) -> list[str]:
    """How pictures are cropped, in words; [] if they aren't, as where the region is empty or the whole picture."""
    roi = fields.get("roi")
    x, y, width, height = ((roi if isinstance(roi, dict) else {}).get(name) or 0 for name in _REGION)
    whole = [0, 0, fields["width"], fields["height"]]
    region = [x, y, width or whole[2], height or whole[3]]
    return [] if region == whole else ["cropped to {2}×{3} px at ({0}, {1})".format(*region)]


def _matrix(data: Any, key: str, shape: tuple[int, int], path: str) -> Array:
    record = take(data, key, dict, path)
    return numbers(record, "data", f"{path}: {key}", finite=True, shape=(shape[0] * shape[1],)).reshape(shape)


def _camera(data: Any, path: str) -> Camera:
    data = _as_file(data, path)
    size = size_of(data, "image_width", "image_height", path)
    K = _matrix(data, "camera_matrix", (3, 3), path)
    record = take(data, "distortion_coefficients", dict, path)
    where = f"{path}: distortion_coefficients"
    D = numbers(record, "data", where, finite=True, shape=(-1,))
    kind = data.get("distortion_model") or {5: "plumb_bob", 8: "rational_polynomial"}.get(len(D))
    if not isinstance(kind, str) or kind not in _LENGTHS:
        raise FormatError(f"{path}: 'distortion_model' must be one of {', '.join(_LENGTHS)}, not {shown(kind)}")
    if len(D) not in _LENGTHS[kind]:
        raise FormatError(f"{where}: {kind} takes {one_of([*map(str, _LENGTHS[kind])])} numbers, not {len(D)}")
    return opencv_camera(path, K, D, size, fisheye=kind == "equidistant")


def _stereo(files: Sequence[tuple[Any, str]]) -> StereoCameras:
    if len(files) != 2:
        raise FormatError(f"{files[0][1]}: {TITLE} holds one camera a file; give the right camera's, too")
    files = [(_as_file(data, path), path) for data, path in files]
    left, right = (_camera(data, path) for data, path in files)
    R_left, R_right = (_matrix(data, "rectification_matrix", (3, 3), path) for data, path in files)
    P_left, P_right = (_matrix(data, "projection_matrix", (3, 4), path) for data, path in files)
    if P_right[0, 0] <= 0 or P_right[1, 1] <= 0 or not P_right[:2, 3].any():
        raise FormatError(
            f"{files[1][1]}: 'projection_matrix' has no baseline; give the right camera of a stereo calibration"
        )
    if P_right[1, 0] or P_right[2, :2].any() or P_right[2, 2] != 1:
        raise FormatError(
            f"{files[1][1]}: 'projection_matrix' must be a camera's (fx 0 cx, 0 fy cy, 0 0 1); export it again"
        )
    shift = np.linalg.solve(P_right[:, :3], P_right[:, 3])
    T = motion(R_right.T @ R_left, R_right.T @ shift)
    return StereoCameras(left, right, T, Rectification.without_q(R_left, R_right, P_left, P_right))


def recognised(data: Any) -> bool:
    """Whether the camera matrix is a plain mapping, where OpenCV's has a tag; or a message."""
    matrices = (value for key, value in data.items() if str(key).lower() == "camera_matrix")
    return _is_message(data) or any(isinstance(value, dict) and not isinstance(value, Matrix) for value in matrices)


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    return {"camera": _camera(data, path)}


_FIT = coefficients(("brown", 5), ("rational", 8), ("fisheye", 4))
FORMAT = Format(
    TITLE,
    load,
    _cameras,
    _text,
    YAML,
    ("pinhole", "brown", "rational", "fisheye"),
    _stereo_texts,
    _stereo,
    _FIT,
    mark="camera_info",
    recognised_yaml=recognised,
    pair_files=2,
    rectified=True,
)
