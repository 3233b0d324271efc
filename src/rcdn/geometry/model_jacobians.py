"""Jacobians of the parametric lens models."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.models import Brown, distorted
from rcdn.types import Array, Camera

NEAR_AXIS = 1e-7
"""rad; below this angle a fisheye's ray is treated as on the axis"""


def distorted_with_jacobian(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """Distorted points (N, 2), in focal lengths, of camera points (N, 3), with their Jacobians with respect to the
    points (N, 2, 3) and to the distortion (N, 2, d); for every model except `division`."""
    return (_fisheye_jacobian if camera.model == "fisheye" else _central_jacobian)(camera, points)


def _central_jacobian(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """`distorted_with_jacobian` of the models pinhole, brown and rational."""
    z = np.where(points[:, 2] > 0, points[:, 2], np.nan)
    n = points[:, :2] / z[:, None]
    lens = Brown.of(camera.distortion)
    a, b, c = lens.jacobian(n)
    by_n = np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], axis=1)
    depth = -(by_n @ n[:, :, None])
    by_point = np.concatenate([by_n, depth], axis=2) / z[:, None, None]
    return lens.distort(n), by_point, _brown_lens(lens, n)[:, :, : len(camera.distortion)]


def _brown_lens(lens: Brown, n: Array) -> Array:
    """Jacobian ∂(distorted point)/∂(k1 k2 p1 p2 k3 k4 k5 k6), (N, 2, 8)."""
    x, y = n.T
    r2 = x * x + y * y
    power = np.stack([r2, r2**2, r2**3], axis=-1)
    below = 1 + power @ lens.denominator
    up = power / below[:, None]
    down = -up * lens.radial(r2)[:, None]
    out = np.empty((len(n), 2, 8))
    for axis, q in enumerate((x, y)):
        out[:, axis, [0, 1, 4]] = q[:, None] * up
        out[:, axis, 5:] = q[:, None] * down
    out[:, 0, 2], out[:, 0, 3] = 2 * x * y, r2 + 2 * x * x
    out[:, 1, 2], out[:, 1, 3] = r2 + 2 * y * y, 2 * x * y
    return out


def _fisheye_jacobian(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """`distorted_with_jacobian` of the Kannala–Brandt model; on the axis the Jacobian's limit is used, which doesn't
    depend on the direction of approach."""
    xy, z = points[:, :2], points[:, 2]
    r = np.hypot(xy[:, 0], xy[:, 1])
    theta, square = np.arctan2(r, z), r * r + z * z
    power = theta[:, None] ** (2 * np.arange(1, 5))
    d = distorted(camera, points)
    slope = 1 + (power * (2 * np.arange(1, 5) + 1)) @ camera.distortion
    off = theta > NEAR_AXIS
    safe = np.where(off, r, 1.0)
    u = np.where(off[:, None], xy / safe[:, None], 0.0)
    radius = (d * u).sum(axis=1)
    across = np.where(off, radius / safe, 1 / np.where(off, 1.0, np.maximum(np.abs(z), 1e-300)))
    along = np.where(off, slope * z / square, across)
    outer = u[:, :, None] * u[:, None, :]
    by_xy = across[:, None, None] * (np.eye(2) - outer) + along[:, None, None] * outer
    by_z = u * (-slope * r / square)[:, None]
    by_lens = u[:, :, None] * (theta[:, None] * power)[:, None, :]
    return d, np.concatenate([by_xy, by_z[:, :, None]], axis=2), by_lens
