"""Estimation and application of homographies."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real

_homography = bind("rcdn_homography")


def homography(src: Array, dst: Array) -> Real[Array, "3 3"]:
    """Homography (3, 3) that maps `src` (N, 2) to `dst` (N, 2), N ≥ 4, by the normalised DLT (Hartley 1997).

    Least squares in the algebraic error for N > 4. Raises RcdnError for other shapes or fewer than 4 points,
    LinAlgError for points that aren't finite.
    """
    src, dst = np.ascontiguousarray(src, float), np.ascontiguousarray(dst, float)
    if src.ndim != 2 or src.shape[1] != 2 or len(src) < 4 or src.shape != dst.shape:
        raise RcdnError("homography: src and dst must be (N, 2) arrays of the same N ≥ 4")
    H = np.empty((3, 3))
    if not _homography(src, dst, H):
        raise np.linalg.LinAlgError("homography: points are not finite")
    return H


def depths(H: Real[Array, "3 3"], points: Real[Array, "n 2"]) -> Real[Array, " n"]:
    """Depths (N,) of `points` (N, 2) under the homography `H` (3, 3), up to a common factor: 0 on its horizon. By sums
    in a fixed order."""
    return np.asarray(H[2, 0] * points[:, 0] + H[2, 1] * points[:, 1] + H[2, 2])


def in_front(H: Real[Array, "3 3"], points: Real[Array, "n 2"], least: float) -> bool:
    """Whether `points` (N, 2) are on one side of the horizon of `H`, with depths of at least the share `least` of the
    largest."""
    depth = depths(H, points)
    low, high = float(depth.min()), float(depth.max())
    return max(low, -high) > least * max(-low, high)


def apply_homography(H: Real[Array, "3 3"], points: Real[Array, "... 2"]) -> Array:
    """`points` (..., 2) mapped by the homography `H` (3, 3)."""
    points = np.asarray(points, float)
    w = points @ H[2, :2] + H[2, 2]
    return (points @ H[:2, :2].T + H[:2, 2]) / w[..., None]


def apply_homographies(H: Real[Array, "c 3 3"], points: Real[Array, "n 2"]) -> Real[Array, "c n 2"]:
    """`points` (N, 2) mapped by each of the homographies `H` (C, 3, 3), by sums in a fixed order."""
    x, y = np.asarray(points, float).T
    u, v, depth = (row[:, :1] * x + row[:, 1:2] * y + row[:, 2:] for row in H.transpose(1, 0, 2))
    return np.stack([u / depth, v / depth], axis=2)
