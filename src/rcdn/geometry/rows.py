"""Rows of arrays of points: concatenation of a list of arrays, and look-up of identical points in another array."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

_rows_among = bind("rcdn_rows_among")


def joint(parts: list[Array], empty: int | tuple[int, ...]) -> Array:
    """The `parts` concatenated; zeros of the shape `empty` if there is none."""
    return np.concatenate(parts) if parts else np.zeros(empty)


def rows_among(xy: Real[Array, "n 2"], among: Real[Array, "m 2"]) -> Int[Array, " n"]:
    """Row (N,) of each of `xy` (N, 2) in `among` (M, 2), the very same numbers; −1 if it isn't there."""
    xy, among = (np.ascontiguousarray(points, np.float64) for points in (xy, among))
    row = np.empty(len(xy), np.int64)
    _rows_among(xy, among, np.empty(1 << (2 * len(among) + 1).bit_length(), np.int64), row)
    return row
