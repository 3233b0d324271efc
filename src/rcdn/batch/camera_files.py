"""The files of `rcdn calibrate -o`: cameras, and undistortion maps."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import ConfigError, FormatError, shown
from rcdn.terminal import console

if TYPE_CHECKING:
    from rcdn.io import CameraFormat, LensFit, StereoCameras
    from rcdn.types import Calibration, Camera, Rig, StereoCalibration


ENDINGS = frozenset({".yaml", ".yml", ".cameramodel", ".json", ".npz", ".toml", ".vnl", ".csv"})
"""endings of files that tell what they hold; .txt, COLMAP's, may be any text"""
EXACT = 0.01
"""largest error of a fitted lens, px, at which a format is taken to represent the lens exactly"""


def chosen_camera(path: Path, name: str | None, option: str = "CAMERA") -> Camera:
    """The camera of a file, or the one called `name`. Raises ConfigError if the file holds several and no `name` is
    given, FormatError if there is none of that name, and as `cameras_of`."""
    if not (names := names_of(path)):
        raise FormatError(f"{path}: holds no camera; calibrate it again")
    if name is None and len(names) > 1:
        raise ConfigError(f"{option} {path} holds several cameras; choose one: --camera-name {' | '.join(names)}")
    if name is not None and name not in names:
        raise FormatError(f"{path}: holds the cameras {', '.join(names)}; name one of them, not {shown(name)}")
    return cameras_of(path, name or names[0])[name or names[0]]


def names_of(path: Path) -> list[str]:
    """The names of the cameras of a file, those of rigs included, also of cameras that can't be read."""
    from rcdn.io import read_rig
    from rcdn.io.cameras import camera_names

    return [*read_rig(path).names] if _is_rig(path) else camera_names(path)


def cameras_of(path: Path, name: str | None = None) -> Mapping[str, Camera]:
    """All cameras of a file by name, those of rigs included; of a file that has one called `name` at least that one.
    Raises FormatError as `read_cameras` and `read_rig`."""
    from rcdn.io import read_camera, read_cameras, read_rig

    if not _is_rig(path):
        known = name is not None and name in names_of(path)
        return {name: read_camera(path, name=name)} if name is not None and known else read_cameras(path)
    rig = read_rig(path)
    return dict(zip(rig.names, rig.cameras, strict=True))


def _is_rig(path: Path) -> bool:
    """Whether `read_rig` reads the file: TOML, or COLMAP's rig_config.json."""
    return path.suffix.lower() == ".toml" or _is_colmap_rig(path)


def _is_colmap_rig(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return path.suffix.lower() == ".json" and file.read(64).lstrip().startswith(b"[")
    except OSError:
        return False


def check_format(path: Path, format: CameraFormat | None, rig: bool = False) -> None:
    """Raise FormatError if the file name determines no format, or (`rig`) no format that holds several cameras and
    their poses, or if it is the name of a file in another format."""
    from rcdn.io import camera_format, rig_format

    if format is not None:
        _check_ending(path, format, rig)
    if rig:
        rig_format(path, format)
        return
    if not holds_maps(path, format):
        camera_format(path, format)


def _check_ending(path: Path, format: CameraFormat, rig: bool) -> None:
    from rcdn.io.cameras import FORMATS

    own = (".json",) if rig and format == "colmap" else FORMATS[format].endings
    if path.suffix.lower() in ENDINGS.difference(own):
        fix = f"end it with {' or '.join(own)}"
        raise FormatError(f"{path}: the name ends as no {format} file does; {fix}")


def pair_files(path: Path, format: CameraFormat | None) -> list[Path]:
    """The files that `write_pair` writes."""
    from rcdn.io import stereo_paths

    return [path] if holds_maps(path, format) else stereo_paths(path, format)


def a_file_a_camera(path: Path, format: CameraFormat | None) -> bool:
    """Whether a rig has a file for each camera in this format."""
    from rcdn.io import rig_paths

    return len(rig_paths(path, ("first", "second"), format)) > 1


def rig_refusal(
    path: Path, format: CameraFormat | None, names: Sequence[str], model: str, known: Mapping[str, Camera]
) -> str:
    """The reason why a file of this format can't hold a rig of cameras with these `names`, some of them `known`, the
    others with the lens `model`; "" if it can, or if that can't be decided yet."""
    from rcdn.io import check_rig

    try:
        check_rig(path, {name: known[name] if name in known else _example(model) for name in names}, format)
    except FormatError as error:
        return str(error)
    return ""


def refusal(path: Path, format: CameraFormat | None, model: str) -> str:
    """The reason why a file of this format can't hold the result of a calibration with the lens `model` (as in
    `rcdn.calibrate`); "" if it can, or if that can't be decided yet."""
    return _refusal(path, format, [_example(model)], stereo=False)


def pair_refusal(
    path: Path, format: CameraFormat | None, model: str, known: tuple[Camera | None, Camera | None]
) -> str:
    """As `refusal`, of a pair of cameras, some of them `known`, the others with the lens `model`."""
    return _refusal(path, format, [camera or _example(model) for camera in known], stereo=True)


def _refusal(path: Path, format: CameraFormat | None, cameras: Sequence[Camera], stereo: bool) -> str:
    from rcdn.io import check_lens

    if holds_maps(path, format):
        return ""
    try:
        for camera in cameras:
            check_lens(path, camera, format, stereo)
    except FormatError as error:
        return str(error)
    return ""


def _example(model: str) -> Camera:
    """A camera with arbitrary parameters of a lens `model`; without distortion if the model is to be chosen from
    several."""
    import numpy as np

    from rcdn.calibration.calibrate import LENSES
    from rcdn.types import Camera

    kind, numbers = LENSES.get(model, ("pinhole", 0))
    return Camera(np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]), np.full(numbers, 0.01), (640, 480), kind)


def write_one(path: Path, camera: Camera, format: CameraFormat | None, fit: LensFit | None = None) -> list[Path]:
    """Write a camera, or, in a format that has no place for its correction, `fit` (default: the nearest lens); print
    which of its properties the format can't represent. Returns the file."""
    from rcdn.io import write_camera, write_maps

    _note_format(path, format)
    if holds_maps(path, format):
        write_maps(path, camera)
    else:
        _note_fits(path, [write_camera(path, camera, format, fit)])
    return [path]


def write_calibrated(path: Path, done: Calibration, format: CameraFormat | None) -> list[Path]:
    """Write the camera of a calibration, as `write_one`; in a format that has no place for its correction, the camera
    that the same corners give without one. Returns the file."""
    from rcdn.calibration.plain_lens import plain_fit

    fit = None if holds_maps(path, format) else plain_fit(str(path), done, format)
    return write_one(path, done.camera, format, fit)


def write_pair(path: Path, found: StereoCalibration | StereoCameras, format: CameraFormat | None) -> list[Path]:
    """Write two cameras, and print which of their properties the format can't represent. Returns the files."""
    from rcdn.io import StereoCameras, lens_fit, write_stereo, write_stereo_maps

    _note_format(path, format)
    if holds_maps(path, format):
        return write_stereo_maps(path, found)
    files = write_stereo(path, found, format)
    pair = StereoCameras.of(found)
    _note_fits(path, [lens_fit(path, camera, format) for camera in (pair.left, pair.right)])
    return files


def write_rig_files(path: Path, rig: Rig, format: CameraFormat | None) -> list[Path]:
    """Write the cameras of a rig, and print which of their properties the format can't represent. Returns the files."""
    from rcdn.io import rig_paths, write_rig

    for name, fit in zip(rig.names, write_rig(path, rig, format), strict=True):
        if fit is not None:
            console.note(f"{path}: camera {name}: {fit.text}")
    return rig_paths(path, rig.names, format)


def check_exact(path: Path, lens: str, fit: LensFit | None) -> None:
    """Raise FormatError if a file can only approximate a `lens` (in words), by `fit`."""
    if fit is not None and fit.largest > EXACT:
        raise FormatError(f"{path}: can't hold {lens}: {fit.text}; --lossy writes that, and json holds it whole")


def holds_maps(path: Path, format: CameraFormat | None) -> bool:
    """Whether undistortion maps are written to `path`."""
    return format is None and path.suffix.lower() == ".npz"


def _note_format(path: Path, format: CameraFormat | None) -> None:
    """Print a note for a name such as `ros.yaml`, which suggests another format than the one that is written."""
    from rcdn.io import camera_format

    if holds_maps(path, format) or format is not None or camera_format(path) != "opencv":
        return
    words = re.split(r"[^a-z]+", path.stem.lower())
    for format_name, part in (("ROS", "camera_info"), ("Kalibr", "camchain")):
        if format_name.lower() in words:
            console.note(f"{path}: written as OpenCV's YAML; for {format_name}'s the name holds {part}")


def _note_fits(path: Path, fits: list[LensFit | None]) -> None:
    for fit in fits:
        if fit is not None:
            console.note(f"{path}: {fit.text}")
