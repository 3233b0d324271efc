"""`rcdn pose`: poses of boards relative to a calibrated camera."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcdn.batch.cache import open_cache
from rcdn.batch.paths import check_file
from rcdn.batch.pose_outputs import tell_poses
from rcdn.batch.saved_cameras import saved_in_folder
from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError, present
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.options import CacheFolder, GridSize, Jobs, MaxMegapixels, NoCache, Pattern, PatternName, parse_size
from rcdn.terminal.spacing import SpacingOrFile, check_spacing, side
from rcdn.terminal.target import DEFAULT, Target

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Board


def pose(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="INPUTS...",
            help="Pictures, folders, patterns or videos, or detections that were saved (.json, .vnl).",
        ),
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The camera, as `rcdn calibrate -o` or --json writes it (OpenCV, ROS, Kalibr, COLMAP, mrcal, JSON).",
        ),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Instead of a camera: a rig, as `rcdn calibrate --rig -o` writes it. INPUTS are then one a camera, or "
            "one folder with a folder or a video of each, as there.",
        ),
    ] = None,
    spacing: SpacingOrFile = None,
    camera_name: Annotated[
        str | None,
        typer.Option("--camera-name", metavar="NAME", help="Which camera of a FILE that holds several: left, cam1, …"),
    ] = None,
    board: Annotated[
        GridSize | None,
        typer.Option(parser=parse_size, metavar="COLSxROWS", help="Only boards of that many inner corners, whole."),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write poses with their covariances as JSON; - is standard output."),
    ] = None,
    pattern: Pattern = PatternName.checker,
    target: Target = DEFAULT,
    jobs: Jobs = 0,
    max_megapixels: MaxMegapixels = None,
    cache: CacheFolder = None,
    no_cache: NoCache = False,
    quiet: Quiet = False,
) -> None:
    """Find where boards stand: a line for each, its corner (0, 0) in metres from the camera (x right, y down, z
    forward).

    Where a picture allows two poses, it says so; of a plain board seen in part, that it is one: its corner (0, 0) is
    then the part's own. The JSON has T_cam_board and the covariance of a small motion after it (rotation vector, rad,
    in camera axes; then metres). A board whose codes were read is placed by the origin of its target's own tools, and
    has T_cam_target, too.

    With --rig there is a line for each moment: the board's place in the rig's frame by all cameras that see it, and who
    they are.

    Exit code: 0 if all was read, 1 if some file failed or no board was found, 2 for wrong use, 130 after Ctrl-C.
    """
    from rcdn.batch.camera_files import chosen_camera
    from rcdn.batch.detection_settings import DetectionSettings
    from rcdn.batch.no_board import note_target
    from rcdn.batch.pose_boards import PoseBoards
    from rcdn.calibration import estimate_pose
    from rcdn.calibration.coded import kind_of
    from rcdn.terminal import camera_text

    console.begin(quiet, [json])
    length, board, pattern = target.length(spacing), target.board(board), target.pattern(pattern)
    check_spacing(length)
    if pattern is PatternName.deltille and board is not None:
        raise ConfigError("--board: a size has no meaning for a deltille; leave it out")
    if (camera is None) == (rig is None):
        raise ConfigError("name the camera (--camera FILE) or the rig (--rig FILE), one of them")
    inputs = inputs if rig is None else saved_in_folder(inputs)
    check_file("--json", json, [Path(i) for i in inputs])
    config = DetectorConfig.preset("auto", pattern=pattern.value, target=target.reads)
    if rig is not None and camera_name is not None:
        raise ConfigError("--camera-name is for --camera; leave it out with --rig")
    lens = None if camera is None else chosen_camera(camera, camera_name, "--camera")
    settings = DetectionSettings(config, open_cache(config, cache, off=no_cache), jobs, board)
    if lens is None:
        from rcdn.batch.rig_poses import rig_poses

        rig_poses(present(rig, "--rig"), inputs, length, settings, json)
        return
    got = settings.gather(inputs)
    for note in got.notes:
        console.note(note)
    note_target(config.target, got)
    boards = PoseBoards([got], board, config.target, length)
    boards.check()

    def solved(image: ImageResult, number: int, found: Board) -> tuple[str, dict[str, Any]]:
        done = estimate_pose(found, lens, side(length, kind_of(found)))
        line = camera_text.pose_line(image.path, done) + boards.line_end(found, len(image.boards) > 1)
        return line, _record(image.path, number, found, boards.complete(found), done)

    wanted = ((image.path, partial(solved, image, k, found)) for image in got.images for k, found in boards.of(image))
    tell_poses(wanted, "poses", length, json, boards)


def _record(path: str, number: int, board: Any, complete: bool, pose: Any) -> dict[str, Any]:
    from rcdn.types.target import target_record

    other = None if pose.other is None else pose.other.T_cam_board.tolist()
    return {
        "path": path,
        "board": number,
        "size": list(board.size),
        "complete": complete,
        "orientation": board.orientation,
        **(
            {}
            if board.target is None
            else {"target": target_record(board.target), "T_cam_target": pose.T_cam_target.tolist()}
        ),
        "T_cam_board": pose.T_cam_board.tolist(),
        "cov": pose.cov.tolist(),
        "rms": pose.rms,
        "ambiguous": pose.ambiguous,
        "other": other,
    }
