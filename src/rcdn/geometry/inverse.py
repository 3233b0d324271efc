"""Rays of distorted points for a lens model with a correction: Newton's method on the stereographic plane."""

from __future__ import annotations

import numpy as np

from rcdn.errors import present
from rcdn.geometry.correction import point_of, stereographic, surface_jacobian
from rcdn.geometry.models import distorted_with_jacobian, fold, undistorted
from rcdn.types import Array, Camera, LensCorrection
from rcdn.types.arrays import Bool, Real

STEPS = 40
"""largest number of Newton steps; four to six suffice unless the initial guess is far away"""
EXACT = 1e-13
"""focal lengths, times 1 + the distance from the axis: below this residual the iteration stops"""
GOOD = 1e-11
"""unit of `EXACT`: a point with a larger residual is not accepted as a solution"""
BLOCK = 1 << 16
"""points at a time, which bounds the memory"""
SHRUNK = (1.0, 0.97, 0.9, 0.75, 0.5)
"""scale factors of a distorted point; the first at which the parametric model can be inverted
gives the initial guess"""
STAGES = 8
"""continuation steps from no correction to the full one, for points where Newton's method fails with the full one"""


def corrected_ray(camera: Camera, d: Array) -> Real[Array, "... 3"]:
    """Rays (..., 3) of distorted points (..., 2), in focal lengths; scale, accuracy and NaN as in `unproject`.

    Also NaN where the complete map reverses orientation (the determinant of its Jacobian is ≤ 0), or where the ray is
    beyond the fold of the parametric model.
    """
    flat = np.asarray(d, float).reshape(-1, 2)
    parts = [_solve(camera, flat[k : k + BLOCK]) for k in range(0, len(flat), BLOCK)]
    u = np.concatenate(parts or [flat])
    rays = point_of(u)
    rays /= (np.linalg.norm(rays, axis=1) if camera.model == "fisheye" else rays[:, 2])[:, None]
    return rays.reshape(*np.shape(d)[:-1], 3)


def unfolded(camera: Camera, rays: Array) -> Bool[Array, " ..."]:
    """(...,) bool: whether the camera's map preserves orientation at rays (..., 3) and these are before the fold of the
    parametric model. Not for the model `division`."""
    u = stereographic(rays).reshape(-1, 2)
    J = _error(camera, camera.correction, u, np.zeros(2))[1]
    return np.asarray(_upright(camera, u, J).reshape(np.shape(rays)[:-1]))


def before_fold(camera: Camera, rays: Array) -> Bool[Array, " ..."]:
    """(...,) bool: whether rays (..., 3) are before the fold of the parametric model. Not for the model `division`."""
    u = stereographic(rays)
    return np.asarray(np.hypot(u[..., 0], u[..., 1]) < 2 * np.tan(fold(camera) / 2))


def _solve(camera: Camera, d: Real[Array, "n 2"]) -> Real[Array, "n 2"]:
    """Stereographic points (N, 2) that the camera maps to the distorted points `d` (N, 2), or NaN."""
    correction = present(camera.correction, "Camera.correction")
    start = _start(camera, d)
    u = _newton(camera, correction, d, start)
    lost = np.flatnonzero(np.isnan(u).any(axis=1) & np.isfinite(start).all(axis=1))
    if len(lost):
        u[lost] = start[lost]
        for stage in range(1, STAGES + 1):
            part = correction.with_control(correction.control * (stage / STAGES))
            u[lost] = _newton(camera, part, d[lost], u[lost])
    return u


def _start(camera: Camera, d: Array) -> Real[Array, "n 2"]:
    """Initial guesses: stereographic points (N, 2) that the parametric model alone maps to `d` or, where that has no
    solution, to a point nearer the axis."""
    u = np.full_like(d, np.nan)
    for share in SHRUNK:
        lost = np.flatnonzero(np.isnan(u).any(axis=1) & np.isfinite(d).all(axis=1))
        if len(lost):
            u[lost] = stereographic(undistorted(camera, share * d[lost]))
    return u


def _newton(camera: Camera, correction: LensCorrection, d: Array, start: Array) -> Real[Array, "n 2"]:
    """Solutions (N, 2) by damped Newton steps from `start`: a step that doesn't reduce the residual is halved; NaN
    where there is no solution or the map is folded."""
    u, scale = start.copy(), 1 + np.hypot(d[:, 0], d[:, 1])
    error, J = _error(camera, correction, u, d)
    damping = np.ones(len(d))
    for _ in range(STEPS):
        size = np.hypot(error[:, 0], error[:, 1])
        open_ = np.flatnonzero((size > EXACT * scale) & (damping > 1e-3))
        if not len(open_):
            break
        step = damping[open_, None] * _solved(J[open_], error[open_])
        trial = u[open_] - step
        e, slope = _error(camera, correction, trial, d[open_])
        better = np.hypot(e[:, 0], e[:, 1]) < size[open_]
        taken = open_[better]
        u[taken], error[taken], J[taken] = trial[better], e[better], slope[better]
        damping[open_] = np.where(better, np.minimum(2 * damping[open_], 1), damping[open_] / 2)
    good = (np.hypot(error[:, 0], error[:, 1]) <= GOOD * scale) & _upright(camera, u, J)
    return np.asarray(np.where(good[:, None], u, np.nan))


def _upright(camera: Camera, u: Array, J: Real[Array, "n 2 2"]) -> Bool[Array, " n"]:
    """(N,) bool: the Jacobian `J` (N, 2, 2) of the map preserves orientation, and `u` is before the fold of the
    parametric model."""
    determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
    return np.asarray((determinant > 0) & (np.hypot(u[:, 0], u[:, 1]) < 2 * np.tan(fold(camera) / 2)))


def _error(camera: Camera, correction: LensCorrection | None, u: Real[Array, "n 2"], d: Array) -> tuple[Array, Array]:
    """Residual (N, 2): the distorted point of `u` (N, 2) minus `d`; and its Jacobian (N, 2, 2) with respect to u. NaN
    where `u` isn't visible."""
    with np.errstate(all="ignore"):
        seen, by_point = distorted_with_jacobian(camera, point_of(u))
        J = by_point[:, :, :2] - by_point[:, :, 2:] * (u / 2)[:, None, :]
        if correction is None:
            return seen - d, J
        shift, by_u = surface_jacobian(correction, u)
        return seen + shift - d, J + by_u


def _solved(J: Array, e: Array) -> Real[Array, "n 2"]:
    """J⁻¹·e (N, 2), with bounded length where J is singular."""
    a, b, c, d = J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1]
    det = a * d - b * c
    det = np.where(np.abs(det) > 1e-6, det, 1e-6)
    return np.stack([d * e[:, 0] - b * e[:, 1], a * e[:, 1] - c * e[:, 0]], axis=-1) / det[:, None]
