"""COLMAP's cameras.txt. Its pixel coordinates are (0.5, 0.5) at the centre of the top-left pixel: half a pixel is added
on writing and subtracted on reading."""

from __future__ import annotations

import re
from typing import Any, get_args

import numpy as np

from rcdn.errors import FormatError, shown
from rcdn.io.cameras.base import Format, coefficients, make_camera, matrix, opencv_camera, pinhole_numbers
from rcdn.io.cameras.yaml_text import digits
from rcdn.types import Array, Camera, CameraModel

TITLE = "COLMAP's cameras.txt"
HALF = 0.5
"""COLMAP's coordinate of the centre of the top-left pixel; rcdn's is 0"""
_HEAD = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
LINE = re.compile(r"\d+\s+[A-Z_0-9]+\s+\d+\s+\d+(\s+[-+.\deE]+)+")

# (number of focal lengths, number of distortion coefficients, rcdn's model; None: OpenCV's coefficients, possibly all
# zero)
_MODELS: dict[str, tuple[int, int, str | None]] = {
    "SIMPLE_PINHOLE": (1, 0, None),
    "PINHOLE": (2, 0, None),
    "SIMPLE_RADIAL": (1, 1, None),
    "RADIAL": (1, 2, None),
    "OPENCV": (2, 4, None),
    "FULL_OPENCV": (2, 8, None),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, "fisheye"),
    "RADIAL_FISHEYE": (1, 2, "fisheye"),
    "OPENCV_FISHEYE": (2, 4, "fisheye"),
    "SIMPLE_DIVISION": (1, 1, "division"),
    "DIVISION": (2, 1, "division"),
}


def _model(camera: Camera) -> tuple[str, Array]:
    d = camera.distortion
    if camera.model == "fisheye":
        return "OPENCV_FISHEYE", d
    if camera.model == "division":
        return "DIVISION", d
    if camera.model == "pinhole":
        return "PINHOLE", d
    return ("FULL_OPENCV", np.concatenate([d, np.zeros(8 - len(d))])) if d[4:].any() else ("OPENCV", d[:4])


def _text(camera: Camera) -> str:
    name, params = model_and_params(camera)
    width, height = camera.image_size
    return f"{_HEAD}# Number of cameras: 1\n1 {name} {width} {height} {' '.join(map(digits, params))}\n"


def model_and_params(camera: Camera) -> tuple[str, list[float]]:
    """COLMAP's name of a camera's lens model, and its PARAMS[]."""
    fx, fy, cx, cy = pinhole_numbers(camera, TITLE)
    name, d = _model(camera)
    return name, [fx, fy, cx + HALF, cy + HALF, *map(float, d)]


def _load(path: str, text: str) -> list[tuple[str, list[str]]]:
    """(where, fields) of each line that isn't a comment."""
    lines = [(f"{path}: line {k}", line.split()) for k, line in enumerate(text.splitlines(), 1)]
    return [(where, fields) for where, fields in lines if fields and not fields[0].startswith("#")]


def camera_of(fields: list[str], where: str) -> Camera:
    """The camera of the fields `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`, given as strings."""
    if not LINE.fullmatch(" ".join(fields)):
        raise FormatError(f"{where} must be `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`, not {shown(' '.join(fields))}")
    name = fields[1]
    if name not in _MODELS:
        raise FormatError(f"{where}: rcdn doesn't know the lens model {shown(name)}; it reads {', '.join(_MODELS)}")
    focal, lens, model = _MODELS[name]
    try:
        width, height, values = int(fields[2]), int(fields[3]), [float(f) for f in fields[4:]]
    except ValueError as error:
        raise FormatError(f"{where}: PARAMS[] must hold numbers") from error
    if len(values) != focal + 2 + lens:
        raise FormatError(f"{where}: {name} takes {focal + 2 + lens} numbers, not {len(values)}")
    cx, cy = values[focal : focal + 2]
    K = matrix(values[0], values[focal - 1], cx - HALF, cy - HALF)
    d = np.array(values[focal + 2 :])
    if model == "division":
        return make_camera(where, K, d, (width, height), "division")
    if lens < 4:
        d = np.concatenate([d, np.zeros(4 - lens)])  # COLMAP's short models end after k1 or k2
    d = d if d[5:].any() else d[:5] if d[4:].any() else d[:4]
    return opencv_camera(where, K, d, (width, height), fisheye=model == "fisheye")


def _cameras(data: Any, path: str) -> dict[str, Camera]:
    if not data:
        raise FormatError(f"{path}: holds no camera; export cameras.txt again")
    return {fields[0]: camera_of(fields, where) for where, fields in data}


_FIT = coefficients(("brown", 5), ("rational", 8), ("fisheye", 4))
_FIRST = re.compile(r"\d+\s+[A-Z_0-9]+\s+\d+\s+\d+\b")
FORMAT = Format(
    TITLE,
    _load,
    _cameras,
    _text,
    (".txt",),
    get_args(CameraModel),
    fit=_FIT,
    recognised=lambda first, _: _FIRST.match(first) is not None,
    parts=lambda data: {fields[0]: [(where, fields)] for where, fields in data},
)
