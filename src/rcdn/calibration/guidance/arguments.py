"""Validation of what a guide is given: frames, their boards and times, and names of pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from rcdn.calibration.arguments import check_board
from rcdn.calibration.labels import Size
from rcdn.errors import ConfigError, shown
from rcdn.types import Array, Board


def seconds(time: Any) -> float:
    """`time` as a float. Raises ConfigError unless it is a finite number."""
    number = isinstance(time, (int, float, np.integer, np.floating)) and not isinstance(time, bool)
    try:
        value = float(time) if number else math.nan
    except OverflowError:  # of a whole number
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(f"time must be a finite number of seconds, such as time.monotonic(), not {shown(time)}")
    return value


def check_by_picture(values: Any, name: str) -> None:
    """Raise ConfigError unless `values` is a mapping from names of pictures."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{name} must be a dict by the pictures' names, not {type(values).__name__}")
    if odd := [key for key in values if not isinstance(key, str)]:
        raise ConfigError(f"name must be text, such as {str(odd[0])!r}, not {shown(odd[0])}")


def check_accepted(name: str, pictures: Collection[str]) -> None:
    """Raise ConfigError unless `name` is one of the accepted `pictures`."""
    if not isinstance(name, str) or name not in pictures:
        raise ConfigError(f"name must be one of the accepted pictures, not {shown(name)}")


def check_of_frame(board: Board, image_size: Size, name: str = "board") -> None:
    """Raise ConfigError unless `board` is one Board of a picture of `image_size` (width, height)."""
    if isinstance(board, (list, tuple)):
        raise ConfigError(f"{name} must be one Board or None, not a {type(board).__name__}: give one of its boards")
    check_board(board, name)
    if board.image_size != image_size:
        (w, h), (width, height) = board.image_size, image_size
        raise ConfigError(f"{name} must be of a picture of {width}×{height} px, not {w}×{h}")


def check_grey(grey: Array, image_size: Size, name: str = "grey") -> None:
    """Raise ConfigError unless `grey` is a grey picture of `image_size` (width, height) with 8 bits."""
    width, height = image_size
    if not isinstance(grey, np.ndarray) or grey.shape != (height, width) or grey.dtype != np.uint8:
        what = f"{grey.shape} {grey.dtype}" if isinstance(grey, np.ndarray) else type(grey).__name__
        raise ConfigError(f"{name} must be the whole frame in grey, an array ({height}, {width}) of uint8, not {what}")
