"""Nearest neighbours and range queries among points of the plane."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

_nearest = bind("rcdn_nearest")
_within = bind("rcdn_within")
ROOM = 4
"""expected number of neighbours within reach of a point, for the size of the first output buffer"""


def nearest(points: Shaped[Array, "n 2"], at: Array, count: int = 1) -> tuple[Array, Array]:
    """Distances and indices (K, `count`) of the `points` (N, 2) nearest to each of `at` (K, 2), in ascending order of
    distance, equal distances in order of index.

    The entries are inf and N where there are fewer points.
    """
    points, at = _flat(points), _flat(at)
    distance, index = np.empty((len(at), count)), np.empty((len(at), count), np.int64)
    _nearest(points, at, distance, index)
    return distance, index


def within(points: Real[Array, "n 2"], at: Real[Array, "k 2"], reach: Real[Array, " k"] | float) -> tuple[Array, Array]:
    """Pairs of `at` (K, 2) and `points` (N, 2) at distances of at most `reach` (K,): rows of `at` (M,) and of `points`
    (M,), sorted."""
    points, at = _flat(points), _flat(at)
    reach = np.full(len(at), float(reach)) if np.ndim(reach) == 0 else np.ascontiguousarray(reach, np.float64)
    room = ROOM * (len(at) + 4)
    while True:
        row, index = np.empty(room, np.int64), np.empty(room, np.int64)
        total = _within(points, at, reach, row, index)
        if total <= room:
            return row[:total], index[:total]
        room = total


def pairs(points: Real[Array, "n 2"], reach: float) -> Int[Array, "m 2"]:
    """All pairs (M, 2) of indices i < j of `points` (N, 2) at distances of at most `reach`, sorted."""
    i, j = within(points, points, reach)
    return np.stack([i, j], axis=1)[i < j]


def _flat(points: Array) -> Array:
    return np.ascontiguousarray(points, np.float64).reshape(-1, 2)
