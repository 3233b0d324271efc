"""The steps of `rcdn pose --rig`: detection in all cameras, and the board's pose at each moment from all cameras that
see it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.batch.detection_settings import DetectionSettings
from rcdn.batch.moments import cameras_in, chosen_by_any, moments_note, moments_of
from rcdn.batch.no_board import note_target
from rcdn.batch.pose_boards import PoseBoards
from rcdn.batch.pose_outputs import tell_poses
from rcdn.batch.spellings import composed
from rcdn.batch.video_rates import rates_note
from rcdn.errors import ConfigError
from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn.terminal.spacing import Length, Lengths, side

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered, Numbers
    from rcdn.types import Board, Rig, RigPoseEstimate

EVERY = 10**9
"""limit on the frames of a video, so large that all sharp and different ones are used"""


def rig_poses(
    path: Path, inputs: Sequence[str], length: Length | Lengths, settings: DetectionSettings, json: Path | None
) -> None:
    """Print the board's pose at each moment in the frame of the rig that is read from `path`, and write the poses as
    JSON."""
    from rcdn.calibration import estimate_rig_pose
    from rcdn.calibration.coded import kind_of
    from rcdn.io import read_rig

    rig = read_rig(path)
    cameras = _named(rig, cameras_in(inputs), path)
    gather = partial(_gathered, settings)
    found = {name: gather(each) for name, each in cameras.items()}
    if note := rates_note(found.values()):
        console.note(note)
    chosen = chosen_by_any([got.frames for got in found.values()])
    found = {
        name: gather(cameras[name], chosen) if chosen and got.frames != chosen else got for name, got in found.items()
    }
    taken = PoseBoards([*found.values()], settings.size, settings.config.target, length)
    taken.check()

    def solved(moment: str, boards: Mapping[str, Board]) -> tuple[str, dict[str, Any]]:
        done = estimate_rig_pose(boards, rig, side(length, kind_of(next(iter(boards.values())))))
        largest = max(boards.values(), key=len)  # whose labels count
        return _line(moment, done) + taken.line_end(largest, False), _record(moment, taken.complete(largest), done)

    wanted = ((moment, partial(solved, moment, boards)) for moment, boards in _moments(found, taken).items())
    tell_poses(wanted, "rig_poses", length, json, taken)


def _gathered(settings: DetectionSettings, inputs: Sequence[str], numbers: Numbers | None = None) -> Gathered:
    """The boards in `inputs`, including those whose codes are seen from behind; of videos in all sharp and different
    frames, or in those with these `numbers`."""
    got = settings.gather(inputs, numbers, frames=EVERY, behind=True)
    note_target(settings.config.target, got)
    return got


def _named(rig: Rig, cameras: Mapping[str, list[str]], path: Path) -> dict[str, list[str]]:
    """The inputs by the names of the rig's cameras: matched by name, or by order if there are equally many."""
    if set(cameras) <= set(rig.names):
        return dict(cameras)
    spelled = {composed(name): name for name in rig.names}
    out = {spelled[composed(name)]: inputs for name, inputs in cameras.items() if composed(name) in spelled}
    if len(out) == len(cameras):
        return out
    if len(cameras) == len(rig):
        console.note(f"note: the inputs are taken for {', '.join(rig.names)}, in this order")
        return dict(zip(rig.names, cameras.values(), strict=True))
    raise ConfigError(
        f"--rig {path}: has cameras {', '.join(rig.names)}, but the inputs are {', '.join(cameras)}; name folders or "
        "videos as the cameras, or give one a camera in that order"
    )


def _moments(found: Mapping[str, Gathered], taken: PoseBoards) -> dict[str, dict[str, Board]]:
    """By moment and camera the largest of the picture's boards that are `taken`; moments without a board are left
    out."""
    from rcdn.io.finding import natural

    keys, way = moments_of([[image.path for image in got.images] for got in found.values()])
    if note := moments_note(keys, way):
        console.note(note)
    out: dict[str, dict[str, Board]] = {}
    for (name, got), each in zip(found.items(), keys, strict=True):
        for moment, image in zip(each, got.images, strict=True):
            boards = [board for _, board in taken.of(image)]
            if boards:
                out.setdefault(moment, {})[name] = max(boards, key=lambda b: (b.target is not None, len(b)))
    return dict(sorted(out.items(), key=lambda item: natural(item[0])))


def _line(moment: str, pose: RigPoseEstimate) -> str:
    from rcdn.terminal.camera_text import position

    T = pose.T_rig_board if pose.T_rig_target is None else pose.T_rig_target
    out = "".join(f"  without {name}: {why}" for name, why in pose.left_out.items())
    return f"{one_line(moment)}  {position(T, pose.cov)}  rms {pose.rms:.3f} px  by {', '.join(pose.residuals)}{out}"


def _record(moment: str, complete: bool, pose: RigPoseEstimate) -> dict[str, Any]:
    target = {} if pose.T_rig_target is None else {"T_rig_target": pose.T_rig_target.tolist()}
    return {
        "moment": moment,
        "cameras": list(pose.residuals),
        "left_out": dict(pose.left_out),
        "complete": complete,
        "T_rig_board": pose.T_rig_board.tolist(),
        **target,
        "cov": pose.cov.tolist(),
        "rms": pose.rms,
    }
