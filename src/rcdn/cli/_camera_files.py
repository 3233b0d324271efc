"""The files of `rcdn calibrate -o`: cameras, and maps that undistort."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rcdn.errors import FormatError

if TYPE_CHECKING:
    from rcdn.io import CameraFormat, LensFit
    from rcdn.types import Camera, StereoCalibration


def check_format(path: Path, format: CameraFormat | None) -> None:
    """Raise FormatError if the name tells no format."""
    from rcdn.io import camera_format

    if not _maps(path, format):
        camera_format(path, format)


def refusal(path: Path, format: CameraFormat | None, model: str, stereo: bool) -> str:
    """Why a file of this format can't hold what a calibration with the lens `model` (of `rcdn.calibrate`) will find; "" if it can, or if
    that isn't known yet."""
    from rcdn.io import check_lens

    if _maps(path, format):
        return ""
    try:
        check_lens(path, _example(model), format, stereo)
    except FormatError as error:
        return str(error)
    return ""


def _example(model: str) -> Camera:
    """A camera with any lens of a `model`; without distortion where it is to be chosen from several."""
    import numpy as np

    from rcdn.calibration.calibrate import LENSES
    from rcdn.types import Camera

    kind, numbers = LENSES.get(model, ("pinhole", 0))
    return Camera(np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]), np.full(numbers, 0.01), (640, 480), kind)


def write_one(path: Path, camera: Camera, format: CameraFormat | None) -> None:
    """Write a camera, and say what the file can't hold of it."""
    from rcdn.io import write_camera, write_maps

    if _maps(path, format):
        write_maps(path, camera)
    else:
        _say(path, [write_camera(path, camera, format)])


def write_pair(path: Path, found: StereoCalibration, format: CameraFormat | None) -> None:
    """Write two cameras, and say what the file can't hold of them."""
    from rcdn.io import lens_fit, write_stereo, write_stereo_maps

    if _maps(path, format):
        write_stereo_maps(path, found)
        return
    write_stereo(path, found, format)
    _say(path, [lens_fit(path, side.camera, format) for side in (found.left, found.right)])


def _maps(path: Path, format: CameraFormat | None) -> bool:
    return format is None and path.suffix.lower() == ".npz"


def _say(path: Path, fits: list[LensFit | None]) -> None:
    for fit in fits:
        if fit is not None:
            typer.echo(f"{path}: {fit.text}", err=True)
