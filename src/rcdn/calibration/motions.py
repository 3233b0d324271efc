"""Rigid motions of boards and cameras: of poses and of points, and derivatives by them."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import rotation
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real

_rigid_points, _rigid_slopes = bind("rcdn_rigid_points"), bind("rcdn_rigid_slopes")
_slopes_before = bind("rcdn_slopes_before")


def moved(T: Array, motions: Array) -> Real[Array, "f 4 4"]:
    """Poses (F, 4, 4) after motions (F, 6): a rotation about the origin of the camera, then a translation."""
    out = T.copy()
    if not len(T):
        return out
    R = rotation(motions[:, :3])
    out[:, :3, :3] = R @ T[:, :3, :3]
    out[:, :3, 3] = (R @ T[:, :3, 3, None])[..., 0] + motions[:, 3:]
    return out


def transformed(T: Real[Array, "f 4 4"], number: Real[Array, " n"], points: Real[Array, "n 3"]) -> Real[Array, "n 3"]:
    """`points` (N, 3) after the rigid motion `number` (N,) among `T`."""
    out = np.empty((len(points), 3))
    _rigid_points(np.ascontiguousarray(T), np.ascontiguousarray(number, np.int64), np.ascontiguousarray(points), out)
    return out


def slopes_before(
    T: Real[Array, "f 4 4"], number: Real[Array, " n"], by_point: Real[Array, "n 2 3"]
) -> Real[Array, "n 2 3"]:
    """Derivatives (N, 2, 3) by points before the rigid motion `number` (N,) among `T`, of those `by_point` after it."""
    out = np.empty(by_point.shape)
    each = np.ascontiguousarray(number, np.int64), np.ascontiguousarray(by_point)
    _slopes_before(np.ascontiguousarray(T), *each, out)
    return out


def by_motion(by_point: Real[Array, "n 2 3"], points: Real[Array, "n 3"]) -> Real[Array, "n 2 6"]:
    """Derivatives (N, 2, 6) by a small motion, rotation before shift, of what depends on `points` (N, 3) with the
    derivatives `by_point` (N, 2, 3)."""
    out = np.empty((len(points), 2, 6))
    _rigid_slopes(np.ascontiguousarray(by_point), np.ascontiguousarray(points), out)
    return out
