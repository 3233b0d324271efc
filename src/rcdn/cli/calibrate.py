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
from rcdn.config import DetectorConfig
from rcdn.errors import CalibrationError, ConfigError, FormatError

if TYPE_CHECKING:
    from rcdn.cli._inputs import Gathered
    from rcdn.cli._pictures import Pictures
    from rcdn.io import CameraFormat, ImageResult
    from rcdn.types import Board, Calibration, StereoCalibration, Verdict


class Model(StrEnum):
    """The lens models of `rcdn.calibrate`."""

    auto = "auto"
    pinhole = "pinhole"
    radtan = "radtan"
    brown = "brown"
    fisheye = "fisheye"
    rational = "rational"


class FailOn(StrEnum):
    """Verdicts that may be failures; `good` isn't."""

    fair = "fair"
    unsure = "unsure"
    bad = "bad"


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
    spacing: Annotated[
        float,
        typer.Option(metavar="METRES", help="Side of one square (or triangle), in metres: 25 mm squares have 0.025."),
    ],
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
    fail_on: Annotated[
        FailOn | None,
        typer.Option(
            "--fail-on",
            help="Exit with 1 if the verdict is this or worse (fair, unsure, bad); files are written all the same.",
        ),
    ] = None,
    pattern: Pattern = PatternName.checker,
    jobs: Jobs = 0,
    frames: Frames = 40,
    cache: CacheFolder = None,
    no_cache: NoCache = False,
) -> None:
    """Calibrate a camera from photographs of a checkerboard, and say how far to trust it.

    Any board will do, nobody has to say its size; partial boards and several boards a picture count, too. Corners and
    views that disagree with the others are left out and named. What was found in a picture is kept for the next run.

    The first line is the verdict: good (use it), fair (with care), unsure (something that the numbers can't vouch for) or bad (don't
    use it), with the gravest reason.

    Exit code: 0 if a camera was found, 1 if not, if a file failed or if the verdict is one of --fail-on, 2 for wrong use, 130 after Ctrl-C.
    """
    from rcdn.calibration.calibrate import check_spacing
    from rcdn.calibration.verdict import fails

    check_spacing(spacing)  # before the work
    if stereo and len(inputs) != 2:
        raise ConfigError(
            f"--stereo takes two inputs, LEFT and RIGHT (folders, quoted patterns such as 'left*.png', videos), not {len(inputs)}"
        )
    if stereo and warp:
        raise ConfigError("--warp is for one camera; leave it away with --stereo")
    if pattern is PatternName.deltille and (board is not None or warp or stereo):
        raise ConfigError("--board, --warp and --stereo know boards of squares only; leave them out for a deltille")
    outputs = _Outputs(output or [], None if file_format is None else file_format.value, report, json)
    outputs.check(inputs)
    config = DetectorConfig.preset("auto", pattern=pattern.value)
    run = _Run(config, open_cache(config, cache, off=no_cache), jobs, frames, board)
    found = (
        _stereo(run, inputs, spacing, model.value, outputs)
        if stereo
        else _mono(run, inputs, spacing, model.value, warp, outputs)
    )
    if run.failed or (fail_on is not None and found is not None and fails(found, fail_on.value)):
        raise typer.Exit(FAILED)


@dataclass(frozen=True)
class _Outputs:
    """What to write, and where."""

    cameras: list[Path]
    format: CameraFormat | None
    report: Path | None
    json: Path | None

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

    def say(self) -> None:
        """Tell what was written."""
        written = [str(p) for p in (*self.cameras, self.json, self.report) if p is not None]
        if written:
            typer.echo(f"written: {', '.join(written)}", err=True)
        else:
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


def _mono(
    run: _Run, inputs: Sequence[str], spacing: float, model: str, warp: bool, outputs: _Outputs
) -> Verdict | None:
    from rcdn.calibration import calibrate
    from rcdn.cli import _camera_text
    from rcdn.io import write_calibration, write_camera
    from rcdn.report.calibration import write_report

    got = run.gather(inputs)
    boards, names = _flat(got.images)
    done = calibrate(boards, spacing, names=names, model=model, size=run.size, warp=warp)
    _say(done, _camera_text.camera_lines(done), _camera_text.left_out_lines(done))
    for path in outputs.cameras:
        write_camera(path, done.camera, outputs.format)
    if outputs.json is not None:
        write_calibration(outputs.json, done)
    if outputs.report is not None:
        write_report(outputs.report, done, _pictures(done))
    outputs.say()
    return done.verdict


def _stereo(run: _Run, inputs: Sequence[str], spacing: float, model: str, outputs: _Outputs) -> Verdict | None:
    from rcdn.calibration import calibrate_stereo
    from rcdn.calibration.stereo_verdict import judged_stereo
    from rcdn.cli import _camera_text
    from rcdn.cli._pairs import pair_names
    from rcdn.io import write_calibration, write_stereo
    from rcdn.report.calibration import write_stereo_report

    left = run.gather(inputs[:1])
    right = run.gather(inputs[1:], left.frames or None)
    pictures = pair_names([i.path for i in left.images], [i.path for i in right.images])
    (boards, names), (others, theirs) = _flat(left.images), _flat(right.images)
    first, second = _first_boards(left.images), _first_boards(right.images)
    pairs = [(first[a], second[b]) for a, b in pictures if a in first and b in second]
    done = judged_stereo(
        calibrate_stereo(boards, others, spacing, pairs=pairs, names=(names, theirs), model=model, size=run.size)
    )
    out = _camera_text.left_out_lines(done.left) + _camera_text.left_out_lines(done.right)
    _say(done, _camera_text.stereo_lines(done), out)
    for path in outputs.cameras:
        write_stereo(path, done, outputs.format)
    if outputs.json is not None:
        write_calibration(outputs.json, done)
    if outputs.report is not None:
        write_stereo_report(outputs.report, done, _pictures(done.left), _pictures(done.right))
    outputs.say()
    return done.verdict


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


def _say(done: Calibration | StereoCalibration, lines: Sequence[str], left_out: Sequence[str]) -> None:
    from rcdn.cli._camera_text import advice_lines, verdict_line

    for line in [*verdict_line(done.verdict), *lines, *left_out, *advice_lines(done.verdict, done.advice)]:
        typer.echo(line)
