"""Valid ranges of numbers in files and arguments. Values outside are mistakes that can't give a meaningful result."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.types.base import Array

POSITION = 1e7
"""px: positions lie within ±POSITION"""
SIDE = 1_000_000
"""px: largest width and height of a picture"""
LABEL = 100_000
"""labels of corners lie within ±LABEL"""
BOX = 4_000_000
"""largest number of labels in a board's bounding box, present or not: an array over them must fit into memory"""
SPACING = (1e-6, 1e3)
"""m: side of a square"""
FOCAL = (1e-9, 1e9)
"""px: focal lengths"""
COEFFICIENT = 1e12
"""coefficients of a lens model lie within ±COEFFICIENT; they are large for long focal lengths"""
RIGID = 1e-5
"""largest deviation of a rotation's rows from orthonormal ones in files, where numbers are rounded to five digits"""
CHAINED = 1e-3
"""that of a pose: it may be a product of many that files hold"""
_IDENTITY = np.eye(3)
LARGEST = 1e100
"""any other number lies within ±LARGEST, so that its square is finite"""


def whole_size(value: Any, what: str) -> tuple[int, int]:
    """(width, height) of a picture as two integers. Raises RcdnError, whose message starts with `what`, unless each is
    an integer from 1 to SIDE."""
    size = two_integers(value)
    if size is None or min(size) < 1 or max(size) > SIDE:
        raise RcdnError(f"{what} must be (width, height), whole numbers from 1 to {SIDE} px, not {shown(value)}")
    return size


def grid_size(value: Any, what: str, least: int) -> tuple[int, int]:
    """(columns, rows) of a board's inner corners as two integers. Raises ConfigError, whose message starts with `what`,
    unless each is at least `least` and their product at most BOX."""
    size = two_integers(value)
    if size is None or min(size) < least or size[0] * size[1] > BOX:
        raise ConfigError(
            f"{what} counts inner corners (columns, rows), at least {least} each and {BOX} in all at most, "
            f"not {shown(value)}"
        )
    return size


def two_integers(value: Any) -> tuple[int, int] | None:
    """`value` as two integers, or None if it isn't a pair of integers."""
    try:
        a, b = value
        pair = int(a), int(b)
        return pair if pair == (a, b) else None
    except (TypeError, ValueError, OverflowError):
        return None


def is_spacing(value: Any) -> bool:
    """Whether `value` is a valid side of a square, m; True isn't."""
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and SPACING[0] <= float(value) <= SPACING[1]
    except OverflowError:
        return False


def is_rigid(T: Array, within: float = RIGID) -> bool:
    """Whether T (4, 4) is a finite rigid transformation; the rows of its rotation may deviate from orthonormal ones by
    `within`."""
    R = T[:3, :3]
    if not (np.abs(R) <= 2).all() or not np.isfinite(T).all() or not np.array_equal(T[3], [0, 0, 0, 1]):
        return False
    return bool((np.abs(R @ R.T - _IDENTITY) <= within + RIGID * _IDENTITY).all() and np.linalg.det(R) > 0)


def focal_trouble(K: Array) -> str:
    """The reason why the focal lengths of K (3, 3) are out of range; "" if they aren't."""
    f = K[[0, 1], [0, 1]]
    if ((f >= FOCAL[0]) & (f <= FOCAL[1])).all():
        return ""
    return f"the focal lengths must be {FOCAL[0]:g} to {FOCAL[1]:g} px, not {f[0]:.6g} and {f[1]:.6g}"


def coefficient_trouble(distortion: Array) -> str:
    """The reason why the coefficients `distortion` (N,) of a lens model are out of range; "" if they aren't."""
    if (np.abs(distortion) <= COEFFICIENT).all():
        return ""
    return f"its numbers must be finite and within ±{COEFFICIENT:g}, not {distortion.tolist()}"


def in_words(low: float, high: float) -> str:
    """Text of a range for messages; either end may be infinite."""
    if math.isfinite(low) and math.isfinite(high):
        return f"in [{low:g}, {high:g}]"
    return f"at least {low:g}" if math.isfinite(low) else f"at most {high:g}"
