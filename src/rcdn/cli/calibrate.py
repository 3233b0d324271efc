"""`rcdn calibrate`: a camera, or a pair of cameras, from photographs of boards."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, cast

import typer

from rcdn.batch.cache import open_cache
from rcdn.batch.calibration_outputs import (
    CameraFileFormat,
    CameraFiles,
    FailOnVerdict,
    Force,
    JsonFile,
    Outputs,
    ReportFile,
)
from rcdn.batch.calibration_runs import BoardReader, Problem, one_camera, two_cameras
from rcdn.batch.detection_settings import DetectionSettings
from rcdn.batch.known_cameras import KnownCameras, camera_paths
from rcdn.batch.moment_file import MomentFile, Moments
from rcdn.batch.pair_file import PairFile, Pairs
from rcdn.batch.rig_runs import many_cameras
from rcdn.batch.saved_cameras import saved_in_folder
from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.group import FAILED
from rcdn.terminal.options import CacheFolder, Frames, Jobs, MaxMegapixels, NoCache, Pattern, PatternName, PicturePlaces
from rcdn.terminal.solve_options import (
    BoardSize,
    CorrectTime,
    FixAspect,
    FixedBoards,
    FixPrincipalPoint,
    Flat,
    LeaveOut,
    LensModel,
    Model,
    Select,
)
from rcdn.terminal.spacing import SpacingOrFile, check_spacing
from rcdn.terminal.target import DEFAULT, Target

if TYPE_CHECKING:
    from rcdn.io import CameraFormat


def calibrate(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="INPUTS...",
            help="Pictures, folders, patterns ('a/*.png') or videos of one camera, or detections that were saved "
            "(.json of rcdn detect, corners.vnl). With --stereo two: the left and the right camera's.",
        ),
    ],
    spacing: SpacingOrFile = None,
    model: LensModel = Model.auto,
    board: BoardSize = None,
    flat: Flat = False,
    fix_aspect: FixAspect = False,
    fix_principal_point: FixPrincipalPoint = False,
    leave_out: LeaveOut = None,
    select: Select = None,
    stereo: Annotated[
        bool,
        typer.Option("--stereo", help="Calibrate two cameras: INPUTS are LEFT and RIGHT, paired by name or order."),
    ] = False,
    rig: Annotated[
        bool,
        typer.Option(
            "--rig",
            help="Calibrate many cameras: an input for each, or one folder with a folder, a video or saved "
            "detections of each; frames of one name or number belong together.",
        ),
    ] = False,
    camera: KnownCameras = None,
    correct_time: CorrectTime = False,
    fixed_boards: FixedBoards = False,
    pairs: Pairs = None,
    moments: Moments = None,
    output: CameraFiles = None,
    file_format: CameraFileFormat = None,
    report: ReportFile = None,
    pictures: PicturePlaces = None,
    json: JsonFile = None,
    force: Force = False,
    fail_on: FailOnVerdict = None,
    pattern: Pattern = PatternName.checker,
    target: Target = DEFAULT,
    jobs: Jobs = 0,
    max_megapixels: MaxMegapixels = None,
    frames: Frames = 40,
    cache: CacheFolder = None,
    no_cache: NoCache = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate a camera from photographs of a checkerboard, and say how far to trust it.

    Any board will do, nobody has to say its size; partial boards and several boards a picture count, too. Corners and
    views that disagree with the others are left out and named. What was found in a picture is kept for the next run.

    The first line is the verdict: good (use it), fair (with care), unsure (something that the numbers can't vouch for)
    or bad (don't use it), with the gravest reason. What the views can't settle is said there, and the camera is written
    then only with --force.

    Exit code: 0 if a camera was found, 1 if not, if it wasn't written, if a file failed or if the verdict is one of
    --fail-on, 2 for wrong use, 130 after Ctrl-C.
    """
    from rcdn.batch.camera_files import refusal
    from rcdn.calibration.frames import CANDIDATES
    from rcdn.calibration.verdict import fails

    console.begin(quiet, [json, report, *(output or ())])
    length, board, pattern = target.length(spacing), target.board(board), target.pattern(pattern)
    check_spacing(length, {"checker": board})  # before the computation
    held = {"aspect": fix_aspect, "principal_point": fix_principal_point}
    fix = frozenset(name for name, fixed in held.items() if fixed)
    if rig:
        _check_rig(
            {
                "--stereo": stereo,
                "--flat": flat,
                "--leave-out": leave_out,
                "--select": select,
                "--fix-aspect and --fix-principal-point": fix,
            }
        )
    if stereo:
        _check_two(
            inputs,
            {
                "--flat": flat,
                "--leave-out": leave_out,
                "--select": select,
                "--fix-aspect and --fix-principal-point": fix,
            },
        )
    if camera and not (rig or stereo):
        raise ConfigError(
            "--camera names lenses that are known, for --rig and --stereo; boards before one known camera are placed "
            "by `rcdn pose`"
        )
    for name, given in (("--correct-time", correct_time), ("--fixed-boards", fixed_boards)):
        if given and not rig:
            raise ConfigError(f"{name} is for cameras of a rig; give it with --rig")
    if moments is not None and not rig:
        raise ConfigError("--moments is for cameras of a rig; give it with --rig")
    if pairs is not None and not stereo:
        raise ConfigError("--pairs is for two cameras; give it with --stereo")
    if pattern is PatternName.deltille and (board is not None or stereo or rig):
        raise ConfigError("--board and --stereo know boards of squares only; leave them out for a deltille")
    inputs = saved_in_folder(inputs) if rig else inputs
    outputs = Outputs(output or [], cast("CameraFormat | None", file_format), report, json, force, pictures or ())
    outputs.check([*inputs, *camera_paths(camera or ()), *(p for p in (pairs, moments) if p is not None)], rig, stereo)
    if not (rig or stereo):
        outputs = outputs.without_refused(lambda path: refusal(path, outputs.format, model.value))
    pair_file = None if pairs is None else PairFile.read(pairs)
    moment_file = None if moments is None else MomentFile.read(moments)
    config = DetectorConfig.preset("auto", pattern=pattern.value, target=target.reads)
    kept = frames if select is None else max(frames, CANDIDATES)
    size = None if board is None else (board.cols, board.rows)
    reader = BoardReader(DetectionSettings(config, open_cache(config, cache, off=no_cache), jobs, size), kept)
    left_out, known = tuple(leave_out or ()), tuple(camera or ())
    problem = Problem(length, model.value, flat, left_out, fix, select, known, correct_time, fixed_boards, moment_file)
    if rig:
        found = many_cameras(reader, inputs, problem, outputs)
    elif stereo:
        found = two_cameras(reader, inputs, problem, outputs, pair_file)
    else:
        found = one_camera(reader, inputs, problem, outputs)
    if reader.failed or (fail_on is not None and found is not None and fails(found, fail_on.value)):
        raise typer.Exit(FAILED)


def _check_two(inputs: list[str], alone: dict[str, object]) -> None:
    """Raise ConfigError unless there are two `inputs`, and no option for a single camera (`alone`) is given."""
    if len(inputs) != 2:
        raise ConfigError(
            "--stereo takes two inputs, LEFT and RIGHT (folders, quoted patterns such as 'left*.png', videos), "
            f"not {len(inputs)}"
        )
    for name, given in alone.items():
        if given:
            verb = "are" if " and " in name else "is"
            raise ConfigError(
                f"{name} {verb} for one camera; leave {'them' if verb == 'are' else 'it'} away with --stereo"
            )


def _check_rig(other: dict[str, object]) -> None:
    """Raise ConfigError if an option was given that doesn't apply to a rig."""
    for name, given in other.items():
        if given:
            raise ConfigError(f"{name} doesn't go with --rig; leave it out")
