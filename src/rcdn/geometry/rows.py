"""Rows of arrays of points: concatenation of a list of arrays, and look-up of identical points in another array."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Int, Real


def joint(parts: list[Array], empty: int | tuple[int, ...]) -> Array:
    """The `parts` concatenated; zeros of the shape `empty` if there is none."""
    return np.concatenate(parts) if parts else np.zeros(empty)


def rows_among(xy: Real[Array, "n 2"], among: Real[Array, "m 2"]) -> Int[Array, " n"]:
    """Row (N,) of each of `xy` (N, 2) in `among` (M, 2), by exact equality; −1 if it isn't there."""
    known = list(map(tuple, among.tolist()))
    place = dict(zip(reversed(known), range(len(known) - 1, -1, -1), strict=True))  # of duplicates the first
    return np.array([place.get(point, -1) for point in map(tuple, xy.tolist())], np.int64)
