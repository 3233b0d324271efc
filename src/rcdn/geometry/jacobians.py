"""Jacobians of the projection and of rotations, for least squares."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.correction import basis, stereographic, stereographic_jacobian, surface_jacobian
from rcdn.geometry.model_jacobians import distorted_with_jacobian
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real


def project_with_jacobian(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of camera points (N, 3), with the Jacobians ∂pixel/∂point (N, 2, 3) and ∂pixel/∂`camera.parameters`
    (N, 2, P).

    Pixels are those of `project`, and the skew is assumed to be zero. With a correction nearly all of the N·2·P numbers
    are zero: `core_jacobian` and `basis` give the others. Raises RcdnError for the model `division`, which is not
    calibrated.
    """
    points = np.asarray(points, float)
    xy, by_point, core = core_jacobian(camera, points)
    if camera.correction is None:
        return xy, by_point, core
    end = core.shape[2]
    jacobian = np.zeros((len(points), 2, end + camera.correction.control.size))
    jacobian[:, :, :end] = core
    columns, weights = basis(camera.correction, points)
    of = np.arange(len(points))[:, None]
    for axis in (0, 1):
        jacobian[of, axis, end + 2 * columns + axis] = camera.K[axis, axis] * weights
    return xy, by_point, jacobian


def core_jacobian(camera: Camera, points: Array) -> tuple[Array, Array, Array]:
    """As `project_with_jacobian`, but the last Jacobian (N, 2, 4 + d) is for fx fy cx cy and the distortion only.

    The derivatives with respect to a correction's control points are its `basis` times the focal length of the axis.
    """
    points = np.asarray(points, float)
    if camera.model == "division":
        raise RcdnError("camera.model 'division' has no derivatives here; use brown, rational or fisheye")
    d, by_point, by_lens = distorted_with_jacobian(camera, points)
    if camera.correction is not None:
        shift, by_u = surface_jacobian(camera.correction, stereographic(points))
        d, by_point = d + shift, by_point + by_u @ stereographic_jacobian(points)
    f = camera.K[[0, 1], [0, 1]]
    jacobian = np.zeros((len(points), 2, camera.coefficients))
    jacobian[:, [0, 1], [0, 1]] = d
    jacobian[:, [0, 1], [2, 3]] = 1.0
    jacobian[:, :, 4:] = by_lens * f[:, None]
    return d @ camera.K[:2, :2].T + camera.K[:2, 2], by_point * f[:, None], jacobian


def rotation(vectors: Array) -> Real[Array, "... 3 3"]:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    vectors = np.asarray(vectors, float)
    K, angle2 = cross_matrix(vectors), (vectors**2).sum(axis=-1)[..., None, None]
    a, b = _rodrigues(angle2)
    return np.asarray(np.eye(3) + a * K + b * (K @ K))


def cross_matrix(vectors: Array) -> Real[Array, "... 3 3"]:
    """Skew-symmetric matrices [v]× (..., 3, 3) of vectors v (..., 3), so that [v]×·w = v × w."""
    vectors = np.asarray(vectors, float)
    x, y, z = np.moveaxis(vectors, -1, 0)
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def _rodrigues(angle2: Array) -> tuple[Array, Array]:
    """sin θ/θ and (1 − cos θ)/θ², given `angle2` = θ²; by their series for small θ."""
    small = angle2 < 1e-8
    square = np.where(small, 1.0, angle2)
    angle = np.sqrt(square)
    a = np.where(small, 1 - angle2 / 6, np.sin(angle) / angle)
    b = np.where(small, 0.5 - angle2 / 24, (1 - np.cos(angle)) / square)
    return a, b
