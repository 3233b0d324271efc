"""The files of `rcdn calibrate -o`: cameras, and maps that undistort."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rcdn.cli._group import say_error
from rcdn.errors import FormatError

if TYPE_CHECKING:
    from rcdn.io import CameraFormat, LensFit
    from rcdn.types import Camera, StereoCalibration


def check_format(path: Path, format: CameraFormat | None) -> None:
    """Raise FormatError if the name tells no format."""
    from rcdn.io import camera_format

    if not _maps(path, format):
        camera_format(path, format)


def write_one(path: Path, camera: Camera, format: CameraFormat | None) -> None:
    """Write a camera, and say what the file can't hold of it."""
    from rcdn.io import write_camera, write_maps

    if _maps(path, format):
        write_maps(path, camera)
    else:
        _say(path, [write_camera(path, camera, format)])


def write_pair(path: Path, found: StereoCalibration, format: CameraFormat | None) -> bool:
    """Write two cameras, and say what the file can't hold of them; False, and why is said, if it can't hold them at all."""
    from rcdn.io import lens_fit, write_stereo, write_stereo_maps

    if _maps(path, format):
        write_stereo_maps(path, found)
        return True
    try:
        write_stereo(path, found, format)
    except FormatError as error:
        say_error(f"{path} is not written: {error}")
        return False
    _say(path, [lens_fit(path, side.camera, format) for side in (found.left, found.right)])
    return True


def _maps(path: Path, format: CameraFormat | None) -> bool:
    return format is None and path.suffix.lower() == ".npz"


def _say(path: Path, fits: list[LensFit | None]) -> None:
    for fit in fits:
        if fit is not None:
            typer.echo(f"{path}: {fit.text}", err=True)
