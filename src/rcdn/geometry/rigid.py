"""Unit rays, rotations and rigid transformations."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Real


def unit(rays: Real[Array, "... 3"]) -> Real[Array, "... 3"]:
    """Vectors (..., 3) of length 1 along `rays`."""
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def motion(R: Array, t: Array) -> Real[Array, "4 4"]:
    """The rigid transformation (4, 4) with a rotation (3, 3) and a translation (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def nearest_rotation(M: Real[Array, "3 3"]) -> Real[Array, "3 3"]:
    """The rotation (3, 3) nearest to a matrix; to a sum of b aᵀ, the one that best takes the vectors a to b (Kabsch,
    Acta Cryst. A32, 1976)."""
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def rotation_angle(R: Real[Array, "3 3"]) -> float:
    """Angle of a rotation, degrees."""
    return float(np.degrees(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))))


def rotation_vector(R: Real[Array, "3 3"]) -> Real[Array, " 3"]:
    """Rotation vector (3,), rad, of a rotation (3, 3), accurate for angles near 0 and π, where cv2.Rodrigues isn't."""
    a, b, c = R
    # the quaternion (x, y, z, w) is the eigenvector of the largest eigenvalue
    K = np.array([
        [a[0] - b[1] - c[2], b[0] + a[1], c[0] + a[2], c[1] - b[2]],
        [b[0] + a[1], b[1] - a[0] - c[2], c[1] + b[2], a[2] - c[0]],
        [c[0] + a[2], c[1] + b[2], c[2] - a[0] - b[1], b[0] - a[1]],
        [c[1] - b[2], a[2] - c[0], b[0] - a[1], a[0] + b[1] + c[2]],
    ])  # fmt: skip
    q = np.linalg.eigh(K)[1][:, -1]
    axis, w = q[:3] * np.copysign(1, q[3]), abs(q[3])
    length = np.linalg.norm(axis)
    return np.asarray(axis * (2 * np.arctan2(length, w) / length if length else 0))
