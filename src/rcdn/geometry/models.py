"""The parametric lens models: distorted points of camera points, in focal lengths, and the inverse, to rays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

REACH = 20.0
"""Largest |x / z| and |y / z| of a ray that `undistorted` finds under the models brown and rational."""

NOTHING = 1e-250
"""coefficients below this are treated as zero: division by such a leading coefficient of a polynomial would overflow"""


def distorted(camera: Camera, points: Array) -> Real[Array, "... 2"]:
    """Distorted points (..., 2), in focal lengths, of camera points (..., 3) by the parametric model alone; NaN for
    points that it can't see."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.model == "fisheye":
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        scale = np.where(r > 1e-12, _radial(theta, camera.distortion) / np.maximum(r, 1e-12), 1.0)
        return np.stack([x * scale, y * scale], axis=-1)
    if camera.model == "division":
        return _division(points, float(camera.distortion[0]))
    with np.errstate(divide="ignore", invalid="ignore"):
        n = np.where((z > 0)[..., None], points[..., :2] / z[..., None], np.nan)
    return n if camera.model == "pinhole" else Brown.of(camera.distortion).distort(n)


def undistorted(camera: Camera, d: Array) -> Real[Array, "... 3"]:
    """Rays (..., 3) of distorted points (..., 2) by the parametric model alone; otherwise as `unproject`."""
    if camera.model == "fisheye":
        return _fisheye_ray(d, camera.distortion)
    if camera.model == "division":
        return _division_ray(d, float(camera.distortion[0]))
    n = d if camera.model == "pinhole" else _brown_inverse(d, Brown.of(camera.distortion))
    return np.concatenate([n, np.ones_like(n[..., :1])], axis=-1)


def fold(camera: Camera) -> float:
    """The angle from the optical axis, rad, at which the radial map of a pinhole, brown, rational or fisheye lens stops
    increasing or its domain ends."""
    if camera.model == "fisheye":
        return min(_first_turn(camera.distortion), np.pi)
    return float(np.arctan(np.inf if camera.model == "pinhole" else Brown.of(camera.distortion).fold()))


def _radial(x: Array, k: Array) -> Array:
    """Radial polynomial x·(1 + k₁x² + k₂x⁴ + …)."""
    x2, total = x * x, 0.0
    for c in k[::-1]:
        total = (total + c) * x2
    return x * (1 + total)


def _first_turn(k: Array) -> float:
    """The first turning point x > 0 of `_radial`, where it stops increasing, or infinity."""
    return _first_root([(2 * i + 3) * float(c) for i, c in enumerate(k)])


def _first_root(coefficients: list[float]) -> float:
    """The smallest root x > 0 of 1 + c₀x² + c₁x⁴ + …, or infinity."""
    kept = [c if abs(c) > NOTHING else 0.0 for c in coefficients]
    try:
        roots = np.roots([*kept[::-1], 1.0])
    except np.linalg.LinAlgError:  # ratios of the coefficients aren't finite: not a lens
        return 0.0
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _radial_inverse(radial: Callable[[Array], Array], value: Array, high: float) -> Array:
    """Solution x of radial(x) = value in [0, high], where `radial` increases, by bisection to the last bit: slow, but
    always convergent."""
    a, b = np.zeros_like(value), np.full_like(value, high)
    for _ in range(60):
        middle = (a + b) / 2
        above = radial(middle) > value
        a, b = np.where(above, a, middle), np.where(above, middle, b)
    return a


def _fisheye_ray(d: Array, k: Array) -> Array:
    """Unit rays (..., 3) of distorted points (..., 2): Newton's method for the angle from the axis, bisection where it
    fails to converge; NaN beyond the fold of the polynomial."""
    r = np.asarray(np.hypot(d[..., 0], d[..., 1]))
    theta = np.minimum(r, np.pi)
    for _ in range(20):
        t2 = theta * theta
        slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
        theta = theta - (_radial(theta, k) - r) / np.where(np.abs(slope) > 1e-3, slope, 1e-3)
        theta = np.clip(theta, 0, np.pi)
    limit = min(_first_turn(k), np.pi)
    theta = np.where((np.abs(_radial(theta, k) - r) < 1e-10 * (1 + r)) & (theta <= limit), theta, np.nan)
    lost = np.isnan(theta) & (r <= _radial(np.asarray(limit), k))
    theta[lost] = _radial_inverse(lambda x: _radial(x, k), r[lost], limit)
    s = np.where(r > 1e-12, np.sin(theta) / np.maximum(r, 1e-12), 1.0)
    return np.stack([d[..., 0] * s, d[..., 1] * s, np.cos(theta)], axis=-1)


def _division(points: Array, k: float) -> Real[Array, "... 2"]:
    """Distorted points d (..., 2) of camera points (..., 3) by the division model d ÷ (1 + k·|d|²) = (x, y) ÷ z: of its
    two roots the one that is 0 on the axis."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 2 / (z + np.sqrt(z * z - 4 * k * (x * x + y * y)))
    seen = np.isfinite(scale) & (scale > 0) & ((z > 0) | (k < 0))
    return np.stack([x, y], axis=-1) * np.where(seen, scale, np.nan)[..., None]


def _division_ray(d: Array, k: float) -> Real[Array, "... 3"]:
    """Unit rays (..., 3) of distorted points d (..., 2); NaN beyond the fold at k·|d|² = 1 (k > 0)."""
    r2 = (d * d).sum(axis=-1)
    ray = np.concatenate([d, (1 + k * r2)[..., None]], axis=-1)
    length = np.where(k * r2 <= 1, np.linalg.norm(ray, axis=-1), np.nan)
    return np.asarray(ray / length[..., None])


@dataclass(frozen=True, eq=False)
class Brown:
    """OpenCV's polynomial model: radius × numerator ÷ denominator (1 for `brown`), plus two tangential terms."""

    numerator: Array
    denominator: Array
    p1: float
    p2: float

    @classmethod
    def of(cls, distortion: Array) -> Brown:
        """The model with the coefficients k1 k2 p1 p2 [k3 [k4 k5 k6]]."""
        k = np.zeros(8)
        k[: len(distortion)] = distortion
        return cls(k[[0, 1, 4]], k[5:], float(k[2]), float(k[3]))

    def radial(self, r2: Array) -> Array:
        """Radial factor at squared radii `r2`."""
        (a, b, c), (d, e, f) = self.numerator, self.denominator
        above = 1 + r2 * (a + r2 * (b + r2 * c))
        if not self.denominator.any():
            return np.asarray(above)
        with np.errstate(divide="ignore", invalid="ignore"):  # a pole is beyond the fold
            return np.asarray(above / (1 + r2 * (d + r2 * (e + r2 * f))))

    def radial_slope(self, r2: Array, g: Array) -> Array:
        """The derivative of the radial factor with respect to r2, where it is `g`."""
        (a, b, c), (d, e, f) = self.numerator, self.denominator
        above = a + r2 * (2 * b + r2 * 3 * c)
        if not self.denominator.any():
            return np.asarray(above)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((above - g * (d + r2 * (2 * e + r2 * 3 * f))) / (1 + r2 * (d + r2 * (e + r2 * f))))

    def distort(self, n: Real[Array, "... 2"]) -> Real[Array, "... 2"]:
        """Distorted points (..., 2) of normalised points `n` (..., 2), both in focal lengths."""
        x, y = n[..., 0], n[..., 1]
        r2 = x * x + y * y
        g = self.radial(r2)
        return np.stack([
            x * g + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
            y * g + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
        ], axis=-1)  # fmt: skip

    def jacobian(self, n: Array) -> tuple[Array, Array, Array]:
        """The entries ∂x′/∂x, ∂x′/∂y = ∂y′/∂x, and ∂y′/∂y of the Jacobian of `distort`, each (...)."""
        x, y = n[..., 0], n[..., 1]
        r2 = x * x + y * y
        g = self.radial(r2)
        slope = self.radial_slope(r2, g)
        return (
            g + 2 * x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x,
            2 * x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y,
            g + 2 * y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x,
        )

    def fold(self) -> float:
        """The undistorted radius at which the radial map stops increasing or has a pole, or infinity."""
        a, b = np.array([1, *self.numerator]), np.array([1, *self.denominator])
        power = 2 * np.arange(4)
        turn = np.convolve(a * (1 + power), b) - np.convolve(a, b * power)  # coefficients of (r·a)′·b − r·a·b′ in r²
        return min(_first_root(list(turn[1:])), _first_root(list(b[1:])))


def _brown_inverse(d: Array, lens: Brown) -> Array:
    """Undistorted points of `d` (..., 2) by Newton's method from the distorted point and, where that fails, from the
    inverse of the radial map; NaN beyond the fold."""
    limit = lens.fold()
    n = _brown_newton(d, d, lens, limit)
    lost = np.isnan(n).any(axis=-1) & np.isfinite(d).all(axis=-1)
    if lost.any():
        far = d[lost]
        r = np.hypot(far[:, 0], far[:, 1])
        high = min(limit * (1 - 1e-12), REACH)  # a pole is excluded, since the map has no value there
        start = far * (_radial_inverse(lambda x: x * lens.radial(x * x), r, high) / np.maximum(r, 1e-12))[:, None]
        n[lost] = _brown_newton(far, start, lens, limit)
    return n


def _brown_newton(d: Array, start: Array, lens: Brown, limit: float) -> Real[Array, "... 2"]:
    """Undistorted points (..., 2) of `d`, by Newton from `start`; NaN where it fails or exceeds the radius `limit`."""
    n = start.copy()
    for _ in range(12):
        a, b, c = lens.jacobian(n)
        det = a * c - b * b
        det = np.where(np.abs(det) > 1e-6, det, 1e-6)
        e = lens.distort(n) - d
        n = n - np.stack([(c * e[..., 0] - b * e[..., 1]) / det, (a * e[..., 1] - b * e[..., 0]) / det], axis=-1)
        n = np.clip(n, -REACH, REACH)
        if float(np.abs(e).max(initial=0.0)) < 1e-13:
            break
    # beyond the first turning point of the radial map the inverse is not unique
    good = (np.abs(lens.distort(n) - d) <= 1e-10).all(axis=-1) & ((n**2).sum(axis=-1) < limit**2)
    return np.asarray(np.where(good[..., None], n, np.nan))
