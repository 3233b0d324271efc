"""The parametric lens models: distorted points of camera points, in focal lengths, with their Jacobians, and the
inverse, to rays. Computed by the kernels of src/native/lens.c."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind, constants
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

NOTHING = 1e-250
"""coefficients below this are treated as zero: division by such a leading coefficient of a polynomial would overflow"""

_C = constants("lens")
_KINDS = {"fisheye": _C["FISHEYE"], "division": _C["DIVISION"]}
_NONE = np.zeros((0, 2)), np.zeros((0, 2, 3))

_pixels, _slopes, _rays = bind("rcdn_lens_pixels"), bind("rcdn_lens_slopes"), bind("rcdn_lens_rays")


def pixels_of(
    camera: Camera, points: Array, shift: Real[Array, "... 2"] | None = None, K: Array | None = None
) -> Real[Array, "... 2"]:
    """Pixels (..., 2) of camera points (..., 3) by the parametric model and `shift` (..., 2), in focal lengths; NaN for
    points that it can't see. `K` (3, 3): default, the camera's."""
    out = np.empty((*points.shape[:-1], 2))
    moved = _NONE[0] if shift is None else _rows(shift, 2)
    _pixels(*_lens(camera), camera.K if K is None else K, _rows(points, 3), moved, out.reshape(-1, 2))
    return out


def pixels_with_jacobian(
    camera: Camera, points: Real[Array, "n 3"], moved: tuple[Array, Array] = _NONE, K: Array | None = None
) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of camera points (N, 3), with their Jacobians by the points (N, 2, 3) and by fx fy cx cy and the
    distortion (N, 2, 4 + d), for a camera matrix without skew. `moved`: shifts (N, 2) of the distorted points, in focal
    lengths, with their Jacobian (N, 2, 3) by the points. `K` (3, 3): default, the camera's. Not for the model
    `division`."""
    count = len(points)
    xy, by_point = np.empty((count, 2)), np.empty((count, 2, 3))
    by_core = np.empty((count, 2, camera.coefficients))
    shift, by_shift = _rows(moved[0], 2), np.ascontiguousarray(moved[1], float)
    _slopes(*_lens(camera), camera.K if K is None else K, _rows(points, 3), shift, by_shift, xy, by_point, by_core)
    return xy, by_point, by_core


def distorted(camera: Camera, points: Array) -> Real[Array, "... 2"]:
    """Distorted points (..., 2), in focal lengths, of camera points (..., 3) by the parametric model alone; NaN for
    points that it can't see."""
    return pixels_of(camera, points, K=np.eye(3))


def distorted_with_jacobian(camera: Camera, points: Real[Array, "n 3"]) -> tuple[Array, Array]:
    """Distorted points (N, 2), in focal lengths, of camera points (N, 3), with their Jacobian by the points (N, 2, 3);
    for every model except `division`."""
    return pixels_with_jacobian(camera, points, K=np.eye(3))[:2]


def undistorted(camera: Camera, d: Array) -> Real[Array, "... 3"]:
    """Rays (..., 3) of distorted points (..., 2) by the parametric model alone; otherwise as `unproject`."""
    if camera.model == "pinhole":
        return np.concatenate([d, np.ones_like(d[..., :1])], axis=-1)
    out = np.empty((*d.shape[:-1], 3))
    limit = np.inf if camera.model == "division" else _fold(camera)
    _rays(*_lens(camera), limit, _rows(d, 2), out.reshape(-1, 3))
    return out


def fold(camera: Camera) -> float:
    """The angle from the optical axis, rad, at which the radial map of a pinhole, brown, rational or fisheye lens stops
    increasing or its domain ends."""
    return _fold(camera) if camera.model == "fisheye" else float(np.arctan(_fold(camera)))


def _lens(camera: Camera) -> tuple[int, Array]:
    """The model and the coefficients as arguments of kernels."""
    k = np.zeros(_C["COEFFICIENTS"])
    k[: len(camera.distortion)] = camera.distortion
    return _KINDS.get(camera.model, _C["CENTRAL"]), k


def _rows(values: Array, columns: int) -> Array:
    return np.ascontiguousarray(values, float).reshape(-1, columns)


def _fold(camera: Camera) -> float:
    """The fold as an angle, rad, of a fisheye; as an undistorted radius, focal lengths, of other lenses."""
    k = camera.distortion
    if camera.model == "fisheye":
        return min(_first_root([(2 * i + 3) * float(c) for i, c in enumerate(k)]), np.pi)
    # OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]]: radius × (1 + k1 r² + k2 r⁴ + k3 r⁶) ÷ (1 + k4 r² + k5 r⁴ + k6 r⁶)
    a, b = np.array([1, *k[:2], *k[4:5]]), np.array([1, *k[5:]])
    # coefficients of (r·a)′·b − r·a·b′ in r²
    turn = np.convolve(a * (1 + 2 * np.arange(len(a))), b) - np.convolve(a, b * 2 * np.arange(len(b)))
    return min(_first_root(list(turn[1:])), _first_root(list(b[1:])))


def _first_root(coefficients: list[float]) -> float:
    """The smallest root x > 0 of 1 + c₀x² + c₁x⁴ + …, or infinity."""
    kept = [c if abs(c) > NOTHING else 0.0 for c in coefficients]
    try:
        roots = np.roots([*kept[::-1], 1.0])
    except np.linalg.LinAlgError:  # ratios of the coefficients aren't finite: not a lens
        return 0.0
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf
