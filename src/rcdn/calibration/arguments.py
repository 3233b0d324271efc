"""Validation of the arguments of public functions: an error names the argument and what is expected."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.geometry.usable_lens import number_trouble
from rcdn.types import Board, BoardShape, Calibration, Camera, Rig, RigCalibration, StereoCalibration
from rcdn.types.ranges import SPACING, grid_size, in_words, is_spacing


def check_spacing(spacing: float) -> None:
    """Raise ConfigError unless `spacing` can be the side of a square."""
    if not is_spacing(spacing):
        raise ConfigError(
            f"spacing is the side of one square in metres and must be positive, {in_words(*SPACING)} (25 mm: 0.025), "
            f"not {shown(spacing)}"
        )


def side_of_square(spacing: float | None, shape: BoardShape | None) -> float:
    """The side of a square in which a pose is: `spacing`, 1 if it is None. Raises ConfigError if it can be none, or if
    there is a `shape`, whose offsets are in metres, and no spacing."""
    if spacing is not None:
        check_spacing(spacing)
        return spacing
    if shape is not None:
        raise ConfigError(
            "spacing must be given with a shape, whose offsets are in metres: that of the calibration, "
            "spacing=calibration.spacing"
        )
    return 1.0


def given_size(size: Any) -> tuple[int, int] | None:
    """The board's `size` (columns, rows) as two integers, of any pair of whole numbers; None if it isn't given. Raises
    ConfigError for anything else."""
    return None if size is None else grid_size(size, "size", 2)


def check_boards(boards: Any, name: str = "boards") -> None:
    """Raise ConfigError unless `boards` is a list of boards."""
    if not isinstance(boards, Sequence):
        raise ConfigError(f"{name} must be a list of boards, not {type(boards).__name__}")
    for k, board in enumerate(boards):
        check_board(board, f"{name}[{k}]")


def check_board(board: Any, name: str = "board") -> None:
    """Raise ConfigError unless `board` is a Board whose corners all have positions."""
    if not isinstance(board, Board):
        raise ConfigError(f"{name} must be a Board, as Detector.boards gives them, not {type(board).__name__}")
    if not np.isfinite(board.xy).all():
        raise ConfigError(f"{name}.xy must be finite; leave out corners that have no position")


def check_own_boards(
    names: Sequence[str], boards: Sequence[Sequence[Board]], when: Sequence[Sequence[Hashable]]
) -> None:
    """Raise ConfigError if two of the cameras `names` have the same boards, corner by corner, at all the moments that
    they share; `when`: for each camera, the moment of each of its boards."""
    seen = [_by_moment(mine, moments) for mine, moments in zip(boards, when, strict=True)]
    for (a, first), (b, second) in combinations(zip(names, seen, strict=True), 2):
        shared = first.keys() & second.keys()
        if shared and all(first[moment] == second[moment] for moment in shared):
            raise ConfigError(
                f"cameras {a} and {b} have the same boards, corner by corner, at the same moments: "
                "give each camera its own pictures"
            )


def _by_moment(boards: Sequence[Board], when: Sequence[Hashable]) -> dict[Hashable, list[bytes]]:
    """The corners' positions of the boards of each moment, as bytes, in an order of their own."""
    out: dict[Hashable, list[bytes]] = {}
    for board, moment in zip(boards, when, strict=True):
        out.setdefault(moment, []).append(board.xy.tobytes())
    return {moment: sorted(each) for moment, each in out.items()}


def check_camera(camera: Any, name: str = "camera") -> None:
    """Raise ConfigError unless `camera` is a Camera with valid parameters."""
    if not isinstance(camera, Camera):
        hint = f"; give {name}=calibration.camera" if isinstance(camera, Calibration) else ""
        raise ConfigError(f"{name} must be a Camera, not {type(camera).__name__}{hint}")
    if trouble := number_trouble(camera):
        raise ConfigError(f"{name}.{trouble}")


def check_calibration(calibration: Any, name: str = "calibration") -> None:
    """Raise ConfigError unless `calibration` is that of one camera."""
    if not isinstance(calibration, Calibration):
        hint = "; give its left or its right" if isinstance(calibration, StereoCalibration) else ""
        hint = "; give one of its cameras" if isinstance(calibration, RigCalibration) else hint
        raise ConfigError(
            f"{name} must be a Calibration, as rcdn.calibrate gives it, not {type(calibration).__name__}{hint}"
        )


def check_rig(rig: Any, name: str = "rig") -> None:
    """Raise ConfigError unless `rig` is a Rig."""
    if not isinstance(rig, Rig):
        hint = f"; give {name}=calibration.rig" if isinstance(rig, RigCalibration) else ""
        raise ConfigError(f"{name} must be a Rig, not {type(rig).__name__}{hint}")


def check_by_camera(values: Any, name: str, what: str) -> None:
    """Raise ConfigError unless `values` is a mapping from names of cameras to `what`."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{name} must be a dict of {what} by the camera's name, not {type(values).__name__}")
    if odd := [key for key in values if not isinstance(key, str)]:
        raise ConfigError(f"{name}: the names of cameras must be text, such as {str(odd[0])!r}, not {shown(odd[0])}")


def check_truth(value: Any, name: str) -> None:
    """Raise ConfigError unless `value` is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ConfigError(f"{name} must be True or False, not {shown(value)}")


def texts(values: Any, name: str) -> list[str]:
    """A list of strings; a single string gives a list of one. Raises ConfigError for anything else."""
    found = [values] if isinstance(values, str) else list(values) if isinstance(values, Collection) else [None]
    if not all(isinstance(v, str) for v in found):
        raise ConfigError(f"{name} must be a list of text, not {shown(values)}")
    return [v for v in found if isinstance(v, str)]
