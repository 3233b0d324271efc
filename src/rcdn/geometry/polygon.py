"""Points in polygons."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.near import nearest
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real

_depth = bind("rcdn_depth")
_deeper = bind("rcdn_deeper")
FEW = 64
"""sides of a polygon that are looked at one by one"""
WIDE = 4.0
"""times its height from which on an outline is looked at on its side"""
FIRST, ALIKE = 16, 1 - 1e-9
"""points that a bound of the least depth is taken from, and the share of it from which on others are as deep"""


def depth(polygon: Array, xy: Real[Array, "m 2"]) -> Array:
    """How deep points `xy` (M, 2) lie in a `polygon` (N, 2): their distances (M,) from its outline, negative outside."""
    polygon, xy = (np.ascontiguousarray(a, np.float64).reshape(-1, 2) for a in (polygon, xy))
    out = np.empty(len(xy))
    _depth(polygon, xy, out)
    return out


def deeper(polygon: Real[Array, "n 2"], xy: Real[Array, "m 2"], limit: float) -> Array:
    """Which points `xy` (M, 2) have a `depth` in a `polygon` (N, 2) over `limit` ≥ 0, (M,) bool; of long outlines only what is near counts."""
    polygon, xy = (np.ascontiguousarray(a, np.float64).reshape(-1, 2) for a in (polygon, xy))
    out = np.empty(len(xy), np.uint8)
    if len(polygon) > FEW and np.ptp(polygon[:, 0]) > WIDE * np.ptp(polygon[:, 1]):
        polygon, xy = (np.ascontiguousarray(a[:, ::-1]) for a in (polygon, xy))  # sides are sorted by their heights
    _deeper(polygon, xy, limit, out)
    return out.view(bool)


def least_depth(polygon: Array, xy: Real[Array, "... 2"]) -> float:
    """The smallest `depth` of points `xy` (..., 2), at least one, to a billionth of it."""
    xy = xy.reshape(-1, 2)
    if len(polygon) <= FEW:
        return float(depth(polygon, xy).min())
    outside = xy[~deeper(polygon, xy, 0.0)]
    if len(outside):
        return float(depth(polygon, outside).min())
    # no point of a side is further from both of its ends than half of its length
    gap = nearest(polygon, xy)[0][:, 0]
    slack = 0.5 * np.linalg.norm(polygon - np.roll(polygon, -1, axis=0), axis=1).max()
    order = np.argsort(gap, kind="stable")
    near = xy[order[gap[order] <= gap.min() + slack]]
    bound = float(depth(polygon, near[:FIRST]).min())
    less = near[~deeper(polygon, near, bound * ALIKE)]
    return min(bound, float(depth(polygon, less).min(initial=np.inf)))
