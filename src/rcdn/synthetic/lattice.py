"""Lattice of a board of squares or triangles: its corners, their neighbours, and the extent of the sheet."""

from __future__ import annotations

import numpy as np

from rcdn.synthetic.scene import BoardSpec
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped
from rcdn.types.plane import ROW

STEPS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
STEPS_DELTILLE = np.array([[1, 0], [0, 1], [-1, 1], [-1, 0], [0, -1], [1, -1]])
"""steps from the label of a corner to those of its neighbours"""


def labels(spec: BoardSpec) -> Array:
    """Labels (cols·rows, 2) of a board's inner corners, row by row."""
    ij = np.stack(np.meshgrid(np.arange(spec.cols), np.arange(spec.rows)), axis=-1).reshape(-1, 2)
    if spec.pattern == "deltille":
        ij[:, 0] -= ij[:, 1] // 2
    return ij


def steps(spec: BoardSpec) -> Array:
    """Steps (4 or 6, 2) from a label to those of its neighbours."""
    return STEPS if spec.pattern == "checker" else STEPS_DELTILLE


def middle(spec: BoardSpec) -> Real[Array, " 2"]:
    """Middle (2,) of the inner corners in the sheet's plane, in squares or edges."""
    if spec.pattern == "checker":
        return np.array([(spec.cols - 1) / 2, (spec.rows - 1) / 2 * spec.aspect])
    return np.array([(spec.cols - 1) / 2 + 0.25 * (spec.rows > 1), (spec.rows - 1) / 2 * ROW * spec.aspect])


def upright(spec: BoardSpec, u: Array, v: Array) -> tuple[Array, Array]:
    """Coordinates in which the sheet's borders are parallel to the axes, from labels (may be fractional): (u, v), for a
    deltille (u + v/2, v)."""
    return (u, v) if spec.pattern == "checker" else (u + v * np.float32(0.5), v)


def from_upright(spec: BoardSpec, uv: Array) -> Shaped[Array, "... 2"]:
    """Labels (..., 2), possibly fractional, from coordinates of `upright`."""
    if spec.pattern == "checker":
        return uv
    return np.stack([uv[..., 0] - 0.5 * uv[..., 1], uv[..., 1]], axis=-1)


def extent(spec: BoardSpec) -> tuple[float, float]:
    """End of the squares or triangles in coordinates of `upright`, from (−1, −1) on. Beyond it lies the margin."""
    half = 0.5 if spec.pattern == "deltille" and spec.rows > 1 else 0.0
    return spec.cols + half, float(spec.rows)
