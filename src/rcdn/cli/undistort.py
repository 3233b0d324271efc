"""`rcdn undistort`: pictures of a calibrated camera, resampled to those of a camera without distortion."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.flat_files import Places, Source, sources
from rcdn.batch.paths import expanded, outside
from rcdn.batch.work import explain, in_thread
from rcdn.errors import ConfigError, OutputError, RcdnError, many
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.group import FAILED, INTERRUPTED, WRONG_USE, print_error, print_stopped
from rcdn.terminal.options import MaxMegapixels, parse_folder
from rcdn.terminal.progress import Bar, progress

if TYPE_CHECKING:
    from rcdn.geometry.resample import Undistortion
    from rcdn.types import Camera

CAMERA_FILE = "undistorted-camera.yaml"
"""file of the undistorted camera, written to the folder of the pictures"""


@dataclass
class _Run:
    """The state of a run: pictures written, failures reported, and whether Ctrl-C ended it; `write_flat` writes the
    camera of the pictures, once the first of them is there: `has_camera` says whether it did."""

    write_flat: Callable[[], None]
    has_camera: bool = False
    written: int = 0
    failed: int = 0
    unwritten: int = 0
    stopped: bool = False
    places: Places = field(default_factory=lambda: Places(False))


def undistort(
    camera: Annotated[
        Path,
        typer.Argument(
            metavar="CAMERA",
            help="The camera, as `rcdn calibrate -o` or --json writes it (OpenCV, ROS, Kalibr, COLMAP, mrcal, JSON).",
        ),
    ],
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGES...", help="Pictures, videos, folders (with all below them), or patterns: 'a/*.png'."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            parser=parse_folder,
            metavar="DIR",
            help="The folder for the pictures, and for their camera's file.",
        ),
    ],
    balance: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            metavar="SHARE",
            help="0: no empty pixels. 1: all that the camera saw, the rest black. Both up to 55° off its axis.",
        ),
    ] = 0.0,
    scale: Annotated[
        float,
        typer.Option(
            min=0.01, max=16, metavar="TIMES", help="Size of the new pictures, as a multiple of the old ones'."
        ),
    ] = 1.0,
    crop: Annotated[
        bool, typer.Option("--crop", help="Cut away the margins with empty pixels that --balance leaves.")
    ] = False,
    rectify: Annotated[
        bool,
        typer.Option(
            "--rectify",
            help="CAMERA holds two cameras, and IMAGES are of the one that --camera-name names: turn them so that what "
            "both cameras see lies in the same rows.",
        ),
    ] = False,
    camera_name: Annotated[
        str | None,
        typer.Option("--camera-name", metavar="NAME", help="Which camera of a file with several: left, cam1, …"),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Also write over files that rcdn hasn't marked as its own.")
    ] = False,
    max_megapixels: MaxMegapixels = None,
    quiet: Quiet = False,
) -> None:
    """Undistort pictures: straight lines become straight, as a pinhole camera would have taken them.

    Pictures keep their names, folders, depth and colours, but not an alpha channel; frames of videos become PNG files
    in a folder of the video's name. Beside them is the camera that they are of now. A picture that can't be read or has
    another size is reported, and the others go on.

    Exit code: 0 if all pictures were written, 1 if some failed, 2 for wrong use, 130 after Ctrl-C.
    """
    from rcdn.batch.camera_files import chosen_camera
    from rcdn.io import write_camera

    console.begin(quiet)
    if rectify and (balance, scale, crop) != (0, 1, False):
        raise ConfigError("--rectify makes pictures of one size for both cameras: leave out --balance, --scale, --crop")
    lens = None if rectify else chosen_camera(camera, camera_name)
    paths, unread = _inputs(images, out, camera)
    make = _rectification(camera, camera_name) if lens is None else _undistortion(lens, balance, scale, crop)
    note = "" if overwrite else _check_camera_file(out / CAMERA_FILE, make.flat)

    def write_flat() -> None:
        if note:
            console.note(note)
        write_camera(out / CAMERA_FILE, make.flat)

    run = _Run(write_flat, failed=unread, places=Places(overwrite))
    _undistort_all(run, paths, out, make)
    _finish(run, make, out)


def _inputs(images: Sequence[str], out: Path, camera: Path) -> tuple[list[Path], int]:
    """The files to read, and the number of arguments that denote none, each already reported. Raises ConfigError if
    writing to `out` would overwrite inputs."""
    from rcdn.io import check_writable

    paths, errors = expanded(images)
    kept = outside(out, images, paths, "--out")
    if len(kept) < len(paths):
        console.note(f"note: skipped: {many(len(paths) - len(kept), 'file')} in {out}, where new pictures go")
    if not kept:
        print_error("there is nothing to read; name pictures, videos or folders that hold some")
        raise typer.Exit(WRONG_USE)
    real = os.path.realpath(out)
    if any(Path(os.path.realpath(p)).is_relative_to(real) for p in kept):
        raise ConfigError(f"--out {out}: pictures in this folder are inputs, too; choose another folder")
    if os.path.realpath(out / CAMERA_FILE) == os.path.realpath(camera):
        raise ConfigError(f"--out {out}: the camera's own file would be written over; choose another folder")
    check_writable(out / CAMERA_FILE)
    return kept, len(errors)


def _check_camera_file(path: Path, flat: Camera) -> str:
    """A note if there is a camera in `path` already that isn't `flat`, or "": the pictures of an earlier run beside it
    are of that one. Raises ConfigError if the file holds none."""
    from rcdn.io import read_camera

    if not os.path.lexists(path):
        return ""
    try:
        there = read_camera(path)
    except RcdnError as error:
        raise ConfigError(
            f"{path}: is there already, and isn't rcdn's; choose another --out, or --overwrite"
        ) from error
    same = there.image_size == flat.image_size and there.model == flat.model
    if same and there.parameters.tolist() == flat.parameters.tolist():
        return ""
    return f"note: {path} held another camera, that of pictures of an earlier run; it is replaced"


def _undistortion(camera: Camera, balance: float, scale: float, crop: bool) -> Undistortion:
    from rcdn.geometry.resample import undistortion

    try:
        return undistortion(camera, balance, scale, crop)
    except RcdnError as error:
        raise ConfigError(str(error)) from error


def _rectification(path: Path, camera_name: str | None) -> Undistortion:
    from rcdn.batch.rig_files import named_pair
    from rcdn.camera_work import rectification_of

    pair, names = named_pair(path)
    if camera_name not in names:
        raise ConfigError(f"--rectify: say which camera's pictures these are: --camera-name {' | '.join(names)}")
    return rectification_of(pair, right=camera_name == names[1])


def _undistort_all(run: _Run, paths: Sequence[Path], out: Path, make: Undistortion) -> None:
    """Process all pictures and fill `run`: another thread reads them while this one undistorts and writes."""
    try:
        with (
            progress(len(paths)) as bar,
            closing(in_thread(lambda: sources(paths, out))) as pictures,
        ):
            for picture in pictures:
                bar.advance(picture.index, picture.name)
                _undistort_one(run, picture, make, bar)
    except KeyboardInterrupt:
        run.stopped = True


def _undistort_one(run: _Run, picture: Source, make: Undistortion, bar: Bar) -> None:
    from rcdn.io import write_image

    try:
        if picture.pixels is None:
            run.failed += 1
            bar.print_error(picture.error)
            return
        pixels = make(picture.pixels)
        write_image(run.places.take(picture.place, str(pixels.dtype)), pixels, mark="rcdn undistorted")
        run.written += 1
        if not run.has_camera:
            run.write_flat()
            run.has_camera = True
    except OutputError as error:
        run.unwritten += 1
        if run.unwritten == 1:  # only the first: a full disk would give one line each
            bar.print_error(str(error))
    except Exception as error:  # one bad picture must not stop the others
        run.failed += 1
        text = explain(error, picture.name)
        bar.print_error(text if text.startswith(picture.name) else f"{picture.name}: {text}")


def _finish(run: _Run, make: Undistortion, out: Path) -> None:
    """Print what was done, and set the exit code."""
    width, height = make.flat.image_size
    line = f"{many(run.written, 'picture')} of {width}×{height} px, f {make.flat.K[0, 0]:.2f} px, in {out}"
    if run.has_camera:
        line += f"; their camera: {out / CAMERA_FILE}"
    if run.unwritten > 1:
        print_error(f"{run.unwritten} pictures could not be written")
    if run.stopped:
        print_stopped(f"; {line}")
        raise typer.Exit(INTERRUPTED)
    console.print_line(line)
    if run.failed or run.unwritten:
        raise typer.Exit(FAILED)
