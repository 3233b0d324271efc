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
    """Rotation vector (3,) of a rotation by less than half a turn, rad."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, (np.trace(R) - 1) / 2)
    return np.asarray(axis * (angle / sine if sine > 1e-12 else 1.0))
