"""`rcdn calibrate`: a camera, or a pair of cameras, from photographs of boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.cli import _batch
from rcdn.cli._cache import Cache, open_cache
from rcdn.cli._group import FAILED
from rcdn.cli._options import CacheFolder, Frames, GridSize, Jobs, NoCache, Pattern, PatternName, parse_size
from rcdn.cli._spacing import Length, Spacing, check_length
from rcdn.config import DetectorConfig
from rcdn.errors import CalibrationError, ConfigError, FormatError

if TYPE_CHECKING:
    from rcdn.cli._inputs import Gathered
    from rcdn.cli._pictures import Pictures
    from rcdn.io import CameraFormat, ImageResult
    from rcdn.types import Board, Calibration


class Model(StrEnum):
    """The lens models of `rcdn.calibrate`."""

    auto = "auto"
    pinhole = "pinhole"
    radtan = "radtan"
    brown = "brown"
    fisheye = "fisheye"
    rational = "rational"


class FileFormat(StrEnum):
    """Formats of camera files."""

    opencv = "opencv"
    ros = "ros"
    kalibr = "kalibr"
    colmap = "colmap"
    mrcal = "mrcal"
    json = "json"


def calibrate(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="INPUTS...",
            help="Pictures, folders, patterns ('a/*.png') or videos of one camera, or detections that were saved (.json of rcdn "
            "detect, corners.vnl). With --stereo two: the left and the right camera's.",
        ),
    ],
    spacing: Spacing,
    model: Annotated[
        Model,
        typer.Option(
            help="The lens: pinhole has no distortion, radtan k1 k2 p1 p2 (Kalibr's), brown k3 too, fisheye four numbers "
            "(Kannala-Brandt), rational eight. auto: the simplest that predicts pictures held out about as well as the best."
        ),
    ] = Model.auto,
    board: Annotated[
        GridSize | None,
        typer.Option(
            parser=parse_size,
            metavar="COLSxROWS",
            help="The board's inner corners: 10x7 squares are 9x6. Not needed; boards that can't be part of it are left out.",
        ),
    ] = None,
    warp: Annotated[bool, typer.Option("--warp", help="The board may be bent a little: solve for that, too.")] = False,
    fix_aspect: Annotated[bool, typer.Option("--fix-aspect", help="Pixels are square: hold fx = fy.")] = False,
    fix_principal_point: Annotated[
        bool,
        typer.Option("--fix-principal-point", help="Hold the principal point in the middle of the picture."),
    ] = False,
    stereo: Annotated[
        bool,
        typer.Option("--stereo", help="Calibrate two cameras: INPUTS are LEFT and RIGHT, paired by name or order."),
    ] = False,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write the camera; may be given several times. By the name: .yaml (OpenCV; camera_info.yaml: ROS, camchain.yaml: "
            "Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json.",
        ),
    ] = None,
    file_format: Annotated[
        FileFormat | None, typer.Option("--format", help="Format of --output, where the name doesn't tell.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page to look at: verdict, coverage, residuals, views.")
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write everything: camera, deviations, poses, residuals of each corner."),
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Write the camera even if the views don't settle its focal length or centre."),
    ] = False,
    pattern: Pattern = PatternName.checker,
    jobs: Jobs = 0,
    frames: Frames = 40,
    cache: CacheFolder = None,
    no_cache: NoCache = False,
) -> None:
    """Calibrate a camera from photographs of a checkerboard, and say how far to trust it.

    Any board will do, nobody has to say its size; partial boards and several boards a picture count, too. Corners and
    views that disagree with the others are left out and named. What was found in a picture is kept for the next run.

    What the views can't settle is said first, and the camera is written then only with --force.

    Exit code: 0 if a camera was found, 1 if not, if it wasn't written, or if a file failed, 2 for wrong use, 130 after Ctrl-C.
    """
    check_length(spacing, board)  # before the work
    if stereo and len(inputs) != 2:
        raise ConfigError(
            f"--stereo takes two inputs, LEFT and RIGHT (folders, quoted patterns such as 'left*.png', videos), not {len(inputs)}"
        )
    fixed = {"aspect": fix_aspect, "principal_point": fix_principal_point}
    fix = frozenset(name for name, held in fixed.items() if held)
    if stereo and fix:
        raise ConfigError("--fix-aspect and --fix-principal-point are for one camera; leave them away with --stereo")
    if stereo and warp:
        raise ConfigError("--warp is for one camera; leave it away with --stereo")
    if pattern is PatternName.deltille and (board is not None or warp or stereo):
        raise ConfigError("--board, --warp and --stereo know boards of squares only; leave them out for a deltille")
    outputs = _Outputs(output or [], None if file_format is None else file_format.value, report, json, force)
    outputs.check(inputs)
    config = DetectorConfig.preset("auto", pattern=pattern.value)
    run = _Run(config, open_cache(config, cache, off=no_cache), jobs, frames, board)
    if stereo:
        _stereo(run, inputs, spacing, model.value, outputs)
    else:
        _mono(run, inputs, spacing, model.value, warp, fix, outputs)
    if run.failed:
        raise typer.Exit(FAILED)


@dataclass(frozen=True)
class _Outputs:
    """What to write, and where."""

    cameras: list[Path]
    format: CameraFormat | None
    report: Path | None
    json: Path | None
    force: bool = False

    def check(self, inputs: Sequence[str]) -> None:
        """Raise before the work what would spoil it afterwards."""
        from rcdn.io import camera_format

        paths = [Path(i) for i in inputs]
        for path in self.cameras:
            try:
                camera_format(path, self.format)
            except FormatError as error:
                raise ConfigError(str(error)) from None
            _batch.check_file("--output", path, paths)
        _batch.check_file("--report", self.report, paths)
        _batch.check_file("--json", self.json, paths)

    def say(self, cameras: bool = True) -> None:
        """Tell what was written, and whether `cameras` were."""
        lost = ", ".join(str(p) for p in self.cameras)
        if lost and not cameras:
            typer.echo(
                f"not written: {lost}: these pictures don't settle the camera; --force writes it all the same", err=True
            )
        written = [str(p) for p in (*(self.cameras if cameras else ()), self.json, self.report) if p is not None]
        if written:
            typer.echo(f"written: {', '.join(written)}", err=True)
        elif not lost:
            typer.echo(
                "nothing is written; add -o camera.yaml, --report report.html or --json calibration.json", err=True
            )


class _Run:
    """How detections are got; `failed`: some file could not be read."""

    def __init__(
        self, config: DetectorConfig, store: Cache | None, jobs: int, frames: int, size: GridSize | None
    ) -> None:
        self.size = None if size is None else (size.cols, size.rows)
        self.failed = False
        self._settings = (config, store, jobs, frames)

    def gather(self, inputs: Sequence[str], numbers: tuple[tuple[int, ...], ...] | None = None) -> Gathered:
        from rcdn.cli._inputs import gather

        config, store, jobs, frames = self._settings
        got = gather(inputs, config, jobs=jobs, cache=store, frames=frames, numbers=numbers, size=self.size)
        self.failed = self.failed or bool(got.failures)
        for note in got.notes:
            typer.echo(note, err=True)
        if not any(image.boards for image in got.images):
            raise CalibrationError(
                f"no board was found in {len(got.images)} pictures; see what `rcdn detect --overlay` draws: squares need sharp, dark-light edges"
            )
        return got

    def check(self, got: Gathered, spacing: Length) -> None:
        """Raise ConfigError if the boards that were found speak against --board or --spacing."""
        from rcdn.calibration.cut import whole_size
        from rcdn.cli._summary import size_hint

        complete = [{b.size for b in image.boards if b.complete} for image in got.images]
        sizes, pictures = set().union(*complete), sum(map(bool, complete))
        if hint := size_hint(self.size, {(max(s), min(s)) for s in sizes}, pictures, len(got.images)):
            if "squares have" in hint:
                raise ConfigError(f"--board {self.size[0]}x{self.size[1]}: {hint}" if self.size else hint)
            typer.echo(f"hint: {hint}", err=True)
        check_length(spacing, self.size or whole_size(_flat(got.images)[0]))


def _mono(
    run: _Run, inputs: Sequence[str], spacing: Length, model: str, warp: bool, fix: frozenset[str], outputs: _Outputs
) -> None:
    from rcdn.calibration import calibrate
    from rcdn.calibration.observability import unsettled
    from rcdn.cli import _camera_text
    from rcdn.io import write_calibration, write_camera
    from rcdn.report.calibration import write_report

    got = run.gather(inputs)
    boards, names = _flat(got.images)
    run.check(got, spacing)
    done = calibrate(boards, float(spacing), names=names, model=model, size=run.size, warp=warp, fix=fix)
    unknown = [u.sentence for u in unsettled(done)]
    views = _camera_text.cut_lines(done) + _camera_text.left_out_lines(done)
    _say([*unknown, *_camera_text.camera_lines(done)], views, done.advice)
    kept = outputs.force or not unknown
    for path in outputs.cameras if kept else ():
        write_camera(path, done.camera, outputs.format)
    if outputs.json is not None:
        write_calibration(outputs.json, done)
    if outputs.report is not None:
        write_report(outputs.report, done, _pictures(done))
    outputs.say(kept)
    run.failed = run.failed or bool(outputs.cameras and not kept)


def _stereo(run: _Run, inputs: Sequence[str], spacing: Length, model: str, outputs: _Outputs) -> None:
    from rcdn.calibration import calibrate_stereo
    from rcdn.cli import _camera_text
    from rcdn.cli._pairs import pair_names
    from rcdn.io import write_calibration, write_stereo
    from rcdn.report.calibration import write_stereo_report

    left = run.gather(inputs[:1])
    right = run.gather(inputs[1:], left.frames or None)
    pictures = pair_names([i.path for i in left.images], [i.path for i in right.images])
    (boards, names), (others, theirs) = _flat(left.images), _flat(right.images)
    run.check(left, spacing)
    run.check(right, spacing)
    first, second = _first_boards(left.images), _first_boards(right.images)
    pairs = [(first[a], second[b]) for a, b in pictures if a in first and b in second]
    done = calibrate_stereo(
        boards, others, float(spacing), pairs=pairs, names=(names, theirs), model=model, size=run.size
    )
    out = _camera_text.left_out_lines(done.left) + _camera_text.left_out_lines(done.right)
    _say(_camera_text.stereo_lines(done), out, done.advice)
    for path in outputs.cameras:
        write_stereo(path, done, outputs.format)
    if outputs.json is not None:
        write_calibration(outputs.json, done)
    if outputs.report is not None:
        write_stereo_report(outputs.report, done, _pictures(done.left), _pictures(done.right))
    outputs.say()


def _flat(images: Sequence[ImageResult]) -> tuple[list[Board], list[str]]:
    """All boards, and the name of each one's picture."""
    boards = [board for image in images for board in image.boards]
    return boards, [image.path for image in images for _ in image.boards]


def _first_boards(images: Sequence[ImageResult]) -> dict[int, int]:
    """For each picture that has boards the index of its largest among all."""
    at, first = 0, {}
    for k, image in enumerate(images):
        if image.boards:
            first[k] = at
        at += len(image.boards)
    return first


def _pictures(calibration: Calibration) -> Pictures:
    from rcdn.cli._pictures import Pictures

    return Pictures(v.name for v in calibration.views)


def _say(lines: Sequence[str], left_out: Sequence[str], advice: Sequence[str]) -> None:
    for line in [*lines, *left_out, *(f"- {text}" for text in advice)]:
        typer.echo(line)
