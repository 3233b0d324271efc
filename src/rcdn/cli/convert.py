"""`rcdn convert`: camera files and files of detections from one format into another."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.detection_files import FORMATS, Contents, format_of
from rcdn.batch.paths import check_file
from rcdn.batch.saved_cameras import holds_detections
from rcdn.errors import ConfigError, FormatError
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.options import GridSize, camera_formats, one_of, parse_size, two_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rcdn.io import CameraFormat, StereoCameras
    from rcdn.types import Camera


def _formats() -> list[str]:
    """File formats: those of cameras, and those of detections; `json` is both."""
    return [*dict.fromkeys([*camera_formats(), *FORMATS])]


def _format(text: str) -> str:
    return one_of(text, _formats())


def _picture_size(text: str) -> GridSize:
    size = two_numbers(text, 5)
    if size is None or min(size) < 1:
        raise typer.BadParameter(f"{text!r} is not a size; give width x height in pixels, such as 1920x1080")
    return size


def convert(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="IN... OUT",
            help="A camera file (OpenCV, ROS, Kalibr, COLMAP, mrcal, JSON, what `rcdn calibrate --json` wrote; two "
            "where a pair has two), a rig (as `rcdn calibrate --rig -o` writes it: one file, or all), or detections "
            "(.json of rcdn detect, corners.vnl); then the file to write. By its name: .yaml (OpenCV; "
            "camera_info.yaml: ROS, camchain.yaml: Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json, .vnl, "
            ".csv; .npz: maps that undistort; of a rig .toml (aniposelib; camera_array.toml: caliscope), "
            "rig_config.json (COLMAP), and .yaml a file a camera, too.",
        ),
    ],
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="FORMAT",
            parser=_format,
            autocompletion=_formats,
            help="The format of OUT, where its name doesn't tell (OUT - is standard output): opencv, ros, kalibr, "
            "colmap, mrcal, json, vnl or csv.",
        ),
    ] = None,
    camera_name: Annotated[
        str | None,
        typer.Option("--camera-name", metavar="NAME", help="Only this camera of a file with several: left, cam1, …"),
    ] = None,
    lossy: Annotated[
        bool, typer.Option("--lossy", help="Write a splined lens as the nearest that the format has.")
    ] = False,
    board: Annotated[
        GridSize | None,
        typer.Option(
            parser=parse_size, metavar="COLSxROWS", help="The board's inner corners, which a .vnl doesn't tell."
        ),
    ] = None,
    image_size: Annotated[
        GridSize | None,
        typer.Option(
            "--image-size",
            parser=_picture_size,
            metavar="WxH",
            help="Size of the pictures, px, of a .vnl whose pictures aren't there.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Convert camera files, or files of detections, from one format into another; which ones, their content and OUT's
    name say.

    Every digit is kept. What a format can't hold is refused, or said; of a splined lens the nearest that OUT can hold
    is written with --lossy.

    Exit code: 0 if it was written, 1 if not, 2 for wrong use.
    """
    if len(files) < 2:
        raise ConfigError("give the file to read, then the file to write: rcdn convert IN OUT")
    *names, last = files
    inputs, out = [Path(name) for name in names], Path(last)
    console.begin(quiet, [out])
    if out != console.STDOUT and any(os.path.realpath(out) == os.path.realpath(p) for p in inputs):
        raise ConfigError(f"{out}: is read and written; name another file to write")
    check_file("OUT", out, inputs)
    of_cameras = {"--camera-name": camera_name is not None, "--lossy": lossy}
    of_detections = {"--board": board is not None, "--image-size": image_size is not None}
    if _holds_detections(inputs[0]):
        if inputs[0].exists():
            _refuse(of_cameras, f"{inputs[0]} holds detections")
        _convert_detections(inputs, out, to, board, image_size)
        written = [out]
    elif (kind := to or out.suffix.lower().removeprefix(".")) in FORMATS and kind not in camera_formats():
        raise FormatError(f"{inputs[0]}: holds no detections, which {kind} is for; give a file of `rcdn detect`")
    else:
        if inputs[0].exists():
            _refuse(of_detections, f"{inputs[0]} holds no detections")
            if out == console.STDOUT and to is None:
                raise FormatError(f"-: standard output; name its format with --to: {', '.join(camera_formats())}")
        written = _convert_cameras(inputs, out, to, camera_name, lossy)
    console.note_written(written)


def _refuse(options: Mapping[str, bool], reason: str) -> None:
    """Raise ConfigError for the first of the `options` (name → whether it is given) that is given: it would have no
    effect."""
    for name in (name for name, given in options.items() if given):
        raise ConfigError(f"{name} has no effect: {reason}; leave it out")


# ---- detections


def _holds_detections(path: Path) -> bool:
    """Whether a file contains detections; False if it can't be read: its reader reports the reason."""
    from rcdn.io.files import is_special

    if is_special(path):
        raise ConfigError(f"{path}: a pipe or a device, not a file; save it as a file first")
    return holds_detections(path)


def _convert_detections(
    inputs: Sequence[Path], out: Path, to: str | None, board: GridSize | None, image_size: GridSize | None
) -> None:
    from rcdn.io import image_line, read_detections, read_vnl_boards

    if len(inputs) > 1:
        raise ConfigError("detections are converted file by file; give one IN and OUT")
    path = inputs[0]
    format = format_of(out, to, "name one with --to") if out == console.STDOUT else format_of(out, to)
    errors: list[tuple[str, str]] = []
    if _is_json(path):
        _refuse({"--image-size": image_size is not None}, f"{path} tells the size of its pictures")
        if format is not FORMATS["vnl"]:
            _refuse({"--board": board is not None}, "neither file is a .vnl, whose boards are of one size")
        images, errors = read_detections(path)
    else:
        images = read_vnl_boards(path, board, image_size)
    for image in images if format.squares_only else ():
        for known in image.boards:
            if known.pattern != "checker":
                raise FormatError(
                    f"{path}: {image.path} has a board of the kind {known.pattern}; {format.squares_only}: write json"
                )
    found = Contents(images, map(image_line, images), errors, board)
    for line in format.left_out(found, format.write(out, found)):
        console.note(f"{out}: {line}")


def _is_json(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(64).lstrip(b"\xef\xbb\xbf \n\r\t").startswith(b"{")
    except OSError:
        return False


# ---- cameras


def _convert_cameras(inputs: Sequence[Path], out: Path, to: str | None, name: str | None, lossy: bool) -> list[Path]:
    """Returns the files that were written."""
    from rcdn.batch.camera_files import (
        check_exact,
        check_format,
        chosen_camera,
        holds_maps,
        names_of,
        write_calibrated,
        write_one,
    )
    from rcdn.batch.rig_files import convert_rig, files_of_pair, holds_rig
    from rcdn.calibration.plain_lens import plain_fit
    from rcdn.io import read_calibrations

    format: CameraFormat | None = to  # type: ignore[assignment]
    if inputs[0].suffix.lower() == ".csv":
        raise FormatError(f"{inputs[0]}: CSV is written, not read; give the .json or .vnl of the same detections")
    inputs = files_of_pair(inputs)
    if name is None and holds_rig(inputs, out):
        return convert_rig(inputs, out, format, lossy)
    check_format(out, format)
    calibrations = read_calibrations(inputs[0])
    if len(inputs) > 2:
        raise ConfigError("give one camera file, or the left and the right one of a pair, and OUT")
    if len(inputs) == 2 or (name is None and len(names_of(inputs[0])) > 1):
        if name is not None:
            raise ConfigError("--camera-name is for one file with several cameras; leave it out, or give one file")
        files = _convert_pair(inputs, out, format, lossy)
    else:
        known = calibrations.get("camera") if name is None else None
        if known is not None:
            if not lossy and not holds_maps(out, format):
                check_exact(out, "the camera's lens", plain_fit(str(out), known, format))
            files = write_calibrated(out, known, format)
        else:
            camera = chosen_camera(inputs[0], name, "IN")
            _check_loss(out, {"": camera}, format, lossy)
            files = write_one(out, camera, format)
    if calibrations:
        console.note(f"{out}: holds the camera; views, deviations and the verdict are in {inputs[0]} only")
    return files


def _convert_pair(inputs: Sequence[Path], out: Path, format: CameraFormat | None, lossy: bool) -> list[Path]:
    from rcdn.batch.camera_files import holds_maps, write_pair
    from rcdn.io.cameras import FORMATS as CAMERAS
    from rcdn.io.cameras import camera_format

    pair = _pair(inputs)
    kind = None if holds_maps(out, format) else camera_format(out, format)
    if out == console.STDOUT and (kind is None or CAMERAS[kind].pair_files > 1):
        raise ConfigError(f"a pair is two files in {kind or 'maps'}; name OUT, to which _left and _right are added")
    _check_loss(out, {"left ": pair.left, "right ": pair.right}, format, lossy)
    files = write_pair(out, pair, format)
    if pair.rectification is not None and kind is not None and not CAMERAS[kind].rectified:
        console.note(f"{out}: holds no rectification, which {kind} has no place for")
    return files


def _pair(inputs: Sequence[Path]) -> StereoCameras:
    from rcdn.batch.rig_files import or_one_camera
    from rcdn.io import read_stereo

    with or_one_camera(inputs):
        return read_stereo(inputs[0], inputs[1] if len(inputs) > 1 else None)


def _check_loss(out: Path, cameras: dict[str, Camera], format: CameraFormat | None, lossy: bool) -> None:
    """Raise FormatError if the format of `out` can only approximate the lens, and that wasn't requested."""
    from rcdn.batch.camera_files import check_exact, holds_maps
    from rcdn.io import lens_fit

    if lossy or holds_maps(out, format):
        return
    for side, camera in cameras.items():
        check_exact(out, f"the {side}camera's lens", lens_fit(out, camera, format))
