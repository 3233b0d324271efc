"""Jacobians of the projection and of rotations, for least squares."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.correction import basis, stereographic, stereographic_jacobian, surface_jacobian
from rcdn.geometry.models import pixels_with_jacobian
from rcdn.native import bind
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

_rotations = bind("rcdn_rotations")


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
    if camera.correction is None:
        return pixels_with_jacobian(camera, points)
    shift, by_u = surface_jacobian(camera.correction, stereographic(points))
    return pixels_with_jacobian(camera, points, (shift, by_u @ stereographic_jacobian(points)))


def rotation(vectors: Array) -> Real[Array, "... 3 3"]:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    vectors = np.ascontiguousarray(vectors, float)
    out = np.empty((*vectors.shape, 3))
    _rotations(vectors.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


def cross_matrix(vectors: Array) -> Real[Array, "... 3 3"]:
    """Skew-symmetric matrices [v]× (..., 3, 3) of vectors v (..., 3), so that [v]×·w = v × w."""
    vectors = np.asarray(vectors, float)
    x, y, z = np.moveaxis(vectors, -1, 0)
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out
