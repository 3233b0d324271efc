"""`rcdn convert`: camera files and files of detections from one format into another."""

from __future__ import annotations

import os
import re
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.paths import check_file
from rcdn.errors import ConfigError, FormatError, many
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.options import GridSize, parse_size

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rcdn.io import CameraFormat, ImageResult, StereoCameras
    from rcdn.types import Camera

EXACT = 0.01
"""largest error of a fitted lens, px, at which a format is taken to represent the lens exactly"""


class To(StrEnum):
    """File formats: `vnl` is for detections, `json` for detections and cameras, the others for cameras."""

    opencv = "opencv"
    ros = "ros"
    kalibr = "kalibr"
    colmap = "colmap"
    mrcal = "mrcal"
    json = "json"
    vnl = "vnl"


def _picture_size(text: str) -> GridSize:
    match = re.fullmatch(r"\s*(\d{1,5})\s*[xX×]\s*(\d{1,5})\s*", text)
    if match is None or min(int(match[1]), int(match[2])) < 1:
        raise typer.BadParameter(f"{text!r} is not a size; give width x height in pixels, such as 1920x1080")
    return GridSize(int(match[1]), int(match[2]))


def convert(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="IN... OUT",
            help="A camera file (OpenCV, ROS, Kalibr, COLMAP, mrcal, JSON, what `rcdn calibrate --json` wrote; two "
            "where a pair has two), a rig (as `rcdn calibrate --rig -o` writes it: one file, or all), or detections "
            "(.json of rcdn detect, corners.vnl); then the file to write. By its name: .yaml (OpenCV; "
            "camera_info.yaml: ROS, camchain.yaml: Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json, .vnl; "
            ".npz: maps that undistort; of a rig .toml (aniposelib; camera_array.toml: caliscope), rig_config.json "
            "(COLMAP), and .yaml a file a camera, too.",
        ),
    ],
    to: Annotated[
        To | None,
        typer.Option("--to", help="The format of OUT, where its name doesn't tell; OUT - is standard output."),
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
    if _holds_detections(inputs[0]):
        _convert_detections(inputs, out, to, board, image_size)
    elif to is To.vnl or (to is None and out.suffix.lower() == ".vnl"):
        raise FormatError(f"{inputs[0]}: holds no detections, which corners.vnl is for; give a file of `rcdn detect`")
    else:
        _convert_cameras(inputs, out, None if to is None else to.value, camera_name, lossy)
    console.note_written([out])


# ---- detections


def _holds_detections(path: Path) -> bool:
    """Whether a file contains detections, judged by its first lines; False if it can't be read: its reader reports the
    reason."""
    from rcdn.io.files import is_special

    if is_special(path):
        raise ConfigError(f"{path}: a pipe or a device, not a file; save it as a file first")
    if path.suffix.lower() == ".vnl":
        return True
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            head = file.read(2000).lstrip("\ufeff \n")
    except OSError:
        return False
    return head.startswith("# filename") or re.match(r'\{[^{\[]*"images"\s*:', head) is not None


def _convert_detections(
    inputs: Sequence[Path], out: Path, to: To | None, board: GridSize | None, image_size: GridSize | None
) -> None:
    from rcdn.io import read_detections, read_vnl_boards, write_detections, write_vnl

    if len(inputs) > 1:
        raise ConfigError("detections are converted file by file; give one IN and OUT")
    kind = to.value if to is not None else out.suffix.lower().lstrip(".")
    if kind not in ("json", "vnl"):
        raise FormatError(f"{out}: detections are written as json or vnl; end the name with one, or give --to")
    path = inputs[0]
    errors: list[tuple[str, str]] = []
    size = None if board is None else (board.cols, board.rows)
    if _is_json(path):
        images, errors = read_detections(path)
    else:
        pixels = None if image_size is None else (image_size.cols, image_size.rows)
        images = read_vnl_boards(path, size, pixels)
    if kind == "json":
        write_detections(out, images, errors)
        return
    _check_squares(path, images)
    written = write_vnl(out, images, size)
    for line in _left_out(images, written, len(errors)):
        console.note(f"{out}: {line}")


def _is_json(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(64).lstrip(b"\xef\xbb\xbf \n\r\t").startswith(b"{")
    except OSError:
        return False


def _check_squares(path: Path, images: Sequence[ImageResult]) -> None:
    """Raise FormatError for boards whose corners don't form a single grid of squares."""
    for image in images:
        for board in image.boards:
            if board.pattern != "checker":
                raise FormatError(
                    f"{path}: {image.path} has a board of the kind {board.pattern}; "
                    "corners.vnl holds grids of squares only: write json"
                )


def _left_out(images: Sequence[ImageResult], size: tuple[int, int] | None, failed: int) -> list[str]:
    """Sentences on the parts of detections that a corners.vnl of a board of `size` can't represent."""
    fitting = [sum(size is not None and b.grid_of(size) is not None for b in image.boards) for image in images]
    boards = sum(len(image.boards) for image in images) - sum(n > 0 for n in fitting)
    loose = sum(len(image.corners) - sum(map(len, image.boards)) for image in images)
    parts = ["deviations and responses"]
    parts += [many(boards, "board")] * (boards > 0)
    parts += [many(loose, "corner outside boards", "corners outside boards")] * (loose > 0)
    parts += [many(failed, "file that could not be read", "files that could not be read")] * (failed > 0)
    held = [] if size is None else [f"holds one board of {size[0]}×{size[1]} corners a picture"]
    return [*held, f"left out: {', '.join(parts)}"]


# ---- cameras


def _convert_cameras(inputs: Sequence[Path], out: Path, to: str | None, name: str | None, lossy: bool) -> None:
    from rcdn.batch.camera_files import check_format, write_one
    from rcdn.batch.rig_files import convert_rig, holds_rig
    from rcdn.io import read_calibrations, read_camera, read_cameras

    format: CameraFormat | None = to  # type: ignore[assignment]
    if name is None and holds_rig(inputs, out):
        convert_rig(inputs, out, format, lossy)
        return
    check_format(out, format)
    if len(inputs) > 2:
        raise ConfigError("give one camera file, or the left and the right one of a pair, and OUT")
    if len(inputs) == 2 or (name is None and len(read_cameras(inputs[0])) > 1):
        if name is not None:
            raise ConfigError("--camera-name is for one file with several cameras; leave it out, or give one file")
        _convert_pair(inputs, out, format, lossy)
    else:
        camera = read_camera(inputs[0], name=name)
        _check_loss(out, {"": camera}, format, lossy)
        write_one(out, camera, format)
    if read_calibrations(inputs[0]):
        console.note(f"{out}: holds the camera; views, deviations and the verdict are in {inputs[0]} only")


def _convert_pair(inputs: Sequence[Path], out: Path, format: CameraFormat | None, lossy: bool) -> None:
    from rcdn.batch.camera_files import write_pair
    from rcdn.io import camera_format

    pair = _pair(inputs)
    kind = "maps" if format is None and out.suffix.lower() == ".npz" else camera_format(out, format)
    if out == console.STDOUT and kind in ("ros", "mrcal", "maps"):
        raise ConfigError(f"a pair is two files in {kind}; name OUT, to which _left and _right are added")
    _check_loss(out, {"left ": pair.left, "right ": pair.right}, format, lossy)
    write_pair(out, pair, format)
    if pair.rectification is not None and kind in ("kalibr", "mrcal"):
        console.note(f"{out}: holds no rectification, which {kind} has no place for")


def _pair(inputs: Sequence[Path]) -> StereoCameras:
    from rcdn.io import read_cameras, read_stereo

    try:
        return read_stereo(inputs[0], inputs[1] if len(inputs) > 1 else None)
    except FormatError as error:
        if len(inputs) > 1:
            raise
        names = " | ".join(read_cameras(inputs[0]))
        raise FormatError(f"{error}; or choose one of its cameras: --camera-name {names}") from error


def _check_loss(out: Path, cameras: dict[str, Camera], format: CameraFormat | None, lossy: bool) -> None:
    """Raise FormatError if the format of `out` can only approximate the lens, and that wasn't requested."""
    from rcdn.io import lens_fit

    if lossy or (format is None and out.suffix.lower() == ".npz"):
        return
    for side, camera in cameras.items():
        fit = lens_fit(out, camera, format)
        if fit is not None and fit.largest > EXACT:
            raise FormatError(
                f"{out}: can't hold the {side}camera's lens: {fit.text}; --lossy writes that, and json holds it whole"
            )
