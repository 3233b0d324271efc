"""Signed distances of points from the outline of a polygon."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.near import nearest
from rcdn.native import bind
from rcdn.types import Array

_depth = bind("rcdn_depth")
_deeper = bind("rcdn_deeper")
FEW = 64
"""sides; polygons with no more are tested side by side, without an index"""
WIDE = 4.0
"""ratio of width to height above which x and y of an outline are swapped"""
FIRST, ALIKE = 16, 1 - 1e-9
"""number of points that give the first bound of the least depth, and the share of this bound above which other points
are not evaluated"""


def depth(polygon: Array, xy: Array) -> Array:
    """Signed distances (M,) of points `xy` (M, 2) from the outline of a `polygon` (N, 2), positive inside."""
    polygon, xy = (np.ascontiguousarray(a, np.float64).reshape(-1, 2) for a in (polygon, xy))
    out = np.empty(len(xy))
    _depth(polygon, xy, out)
    return out


def deeper(polygon: Array, xy: Array, limit: float) -> Array:
    """(M,) bool: whether points `xy` (M, 2) have a `depth` in a `polygon` (N, 2) above `limit` ≥ 0; for long outlines
    only the sides near a point are evaluated."""
    polygon, xy = (np.ascontiguousarray(a, np.float64).reshape(-1, 2) for a in (polygon, xy))
    out = np.empty(len(xy), np.uint8)
    if len(polygon) > FEW and np.ptp(polygon[:, 0]) > WIDE * np.ptp(polygon[:, 1]):
        polygon, xy = (np.ascontiguousarray(a[:, ::-1]) for a in (polygon, xy))  # the kernel sorts the sides by y
    _deeper(polygon, xy, limit, out)
    return out.view(bool)


def least_depth(polygon: Array, xy: Array) -> float:
    """The smallest `depth` of points `xy` (..., 2), at least one, to a relative accuracy of 1e-9."""
    xy = xy.reshape(-1, 2)
    if len(polygon) <= FEW:
        return float(depth(polygon, xy).min())
    outside = xy[~deeper(polygon, xy, 0.0)]
    if len(outside):
        return float(depth(polygon, outside).min())
    # every point of a side lies within half of the side's length of one of its ends
    gap = nearest(polygon, xy)[0][:, 0]
    slack = 0.5 * np.linalg.norm(polygon - np.roll(polygon, -1, axis=0), axis=1).max()
    order = np.argsort(gap, kind="stable")
    near = xy[order[gap[order] <= gap.min() + slack]]
    bound = float(depth(polygon, near[:FIRST]).min())
    less = near[~deeper(polygon, near, bound * ALIKE)]
    return min(bound, float(depth(polygon, less).min(initial=np.inf)))
