"""Homographies, lens models and poses. The only place where any of them lives."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array, Camera, Pose

REACH = 20.0
"""Largest |x / z| and |y / z| of a ray that `unproject` finds under the brown model."""


def homography(src: Array, dst: Array) -> Array:
    """Homography (3, 3) that takes `src` (N, 2) to `dst` (N, 2), N ≥ 4, by the normalised DLT (Hartley 1997).

    Least squares in the algebraic error for N > 4. Raises RcdnError for other shapes or fewer than 4 points.
    """
    src, dst = np.asarray(src, float), np.asarray(dst, float)
    if src.ndim != 2 or src.shape[1] != 2 or len(src) < 4 or src.shape != dst.shape:
        raise RcdnError("homography: src and dst must be (N, 2) arrays of the same N ≥ 4")
    Ts, Td = _normaliser(src), _normaliser(dst)
    p, q = apply_homography(Ts, src), apply_homography(Td, dst)
    zero, one = np.zeros(len(p)), np.ones(len(p))
    x, y, u, v = p[:, 0], p[:, 1], q[:, 0], q[:, 1]
    rows = np.concatenate([
        np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
        np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
    ])  # fmt: skip
    H = np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3)  # U is large and not needed
    return np.linalg.solve(Td, H @ Ts)


def _normaliser(points: Array) -> Array:
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / max(float(np.linalg.norm(points - centre, axis=1).mean()), 1e-12)
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def apply_homography(H: Array, points: Array) -> Array:
    """`points` (..., 2) through `H` (3, 3)."""
    points = np.asarray(points, float)
    w = points @ H[2, :2] + H[2, 2]
    return (points @ H[:2, :2].T + H[:2, 2]) / w[..., None]


def transform(pose: Pose, points: Array) -> Array:
    """Board points (..., 3) in camera coordinates."""
    return np.asarray(points, float) @ pose.R.T + pose.t


def project(camera: Camera, points: Array) -> Array:
    """Camera points (..., 3) to pixels (..., 2). z ≤ 0 gives NaN (but for `fisheye` and a barrel of
    the `division` model, which see behind themselves).

    Beyond the fold of a lens polynomial the pixel is still the polynomial's, though no light from that point gets
    there: `unproject` gives another ray for it, or NaN.
    """
    points = np.asarray(points, float)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.model == "fisheye":
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        scale = np.where(r > 1e-12, _radial(theta, camera.distortion) / np.maximum(r, 1e-12), 1.0)
        d = np.stack([x * scale, y * scale], axis=-1)
    elif camera.model == "division":
        d = _division(points, float(camera.distortion[0]))
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            n = np.where((z > 0)[..., None], points[..., :2] / z[..., None], np.nan)
        d = n if camera.model == "pinhole" else _brown(n, camera.distortion)
    return d @ camera.K[:2, :2].T + camera.K[:2, 2]


def unproject(camera: Camera, pixels: Array) -> Array:
    """Pixels (..., 2) to viewing rays (..., 3) of unit z (`fisheye` and `division`: unit length).

    Exact to 1e-10 where the lens model can be inverted, else NaN: beyond the fold, where the polynomial turns back.
    """
    pixels = np.asarray(pixels, float)
    K = camera.K
    y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
    d = np.stack([(pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)
    if camera.model == "fisheye":
        return _fisheye_ray(d, camera.distortion)
    if camera.model == "division":
        return _division_ray(d, float(camera.distortion[0]))
    n = d if camera.model == "pinhole" else _brown_inverse(d, camera.distortion)
    return np.concatenate([n, np.ones_like(n[..., :1])], axis=-1)


def _radial(x: Array, k: Array) -> Array:
    """x·(1 + k₁x² + k₂x⁴ + …)."""
    x2, total = x * x, 0.0
    for c in k[::-1]:
        total = (total + c) * x2
    return x * (1 + total)


def _first_turn(k: Array) -> float:
    """Where `_radial` stops growing: its first turning point, or infinity."""
    slope = [(2 * i + 3) * float(c) for i, c in enumerate(k)]
    roots = np.roots([*slope[::-1], 1.0])
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _radial_inverse(k: Array, value: Array, high: float) -> Array:
    """x in [0, high], where `_radial` grows, by bisection to the last bit: slow and sure."""
    a, b = np.zeros_like(value), np.full_like(value, high)
    for _ in range(60):
        middle = (a + b) / 2
        above = _radial(middle, k) > value
        a, b = np.where(above, a, middle), np.where(above, middle, b)
    return a


def _fisheye_ray(d: Array, k: Array) -> Array:
    """Newton in the angle from the axis, bisection where it goes astray; NaN beyond the fold of the polynomial."""
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
    theta[lost] = _radial_inverse(k, r[lost], limit)
    s = np.where(r > 1e-12, np.sin(theta) / np.maximum(r, 1e-12), 1.0)
    return np.stack([d[..., 0] * s, d[..., 1] * s, np.cos(theta)], axis=-1)


def _division(points: Array, k: float) -> Array:
    """Distorted points (..., 2) of camera points (..., 3) under d ÷ (1 + k·|d|²) ∝ (x, y) ÷ z: the root that is 0 on the axis."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 2 / (z + np.sqrt(z * z - 4 * k * (x * x + y * y)))
    seen = np.isfinite(scale) & (scale > 0) & ((z > 0) | (k < 0))
    return np.stack([x, y], axis=-1) * np.where(seen, scale, np.nan)[..., None]


def _division_ray(d: Array, k: float) -> Array:
    """Unit rays (..., 3) of distorted points (..., 2); NaN beyond the fold at k·|d|² = 1 (k > 0)."""
    r2 = (d * d).sum(axis=-1)
    ray = np.concatenate([d, (1 + k * r2)[..., None]], axis=-1)
    length = np.where(k * r2 <= 1, np.linalg.norm(ray, axis=-1), np.nan)
    return np.asarray(ray / length[..., None])


def _brown(n: Array, dist: Array) -> Array:
    k1, k2, p1, p2 = dist[:4]
    k3 = dist[4] if len(dist) > 4 else 0.0
    x, y = n[..., 0], n[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack([
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    ], axis=-1)  # fmt: skip


def _brown_inverse(d: Array, dist: Array) -> Array:
    """Newton from the distorted point and, where that goes astray, from the radial solution; NaN beyond the fold."""
    k = np.append(dist[:2], dist[4:5])
    limit = _first_turn(k)
    n = _brown_newton(d, d, dist, limit)
    lost = np.isnan(n).any(axis=-1) & np.isfinite(d).all(axis=-1)
    if lost.any():
        far = d[lost]
        r = np.hypot(far[:, 0], far[:, 1])
        start = far * (_radial_inverse(k, r, min(limit, REACH)) / np.maximum(r, 1e-12))[:, None]
        n[lost] = _brown_newton(far, start, dist, limit)
    return n


def _brown_newton(d: Array, start: Array, dist: Array, limit: float) -> Array:
    """Undistorted points (..., 2) of `d` by Newton from `start`; NaN where it fails or leaves the radius `limit`."""
    k1, k2, p1, p2 = dist[:4]
    k3 = dist[4] if len(dist) > 4 else 0.0
    n = start.copy()
    for _ in range(12):
        x, y = n[..., 0], n[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
        a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
        b = x * y * slope + 2 * p1 * x + 2 * p2 * y
        c = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
        det = a * c - b * b
        det = np.where(np.abs(det) > 1e-6, det, 1e-6)
        e = _brown(n, dist) - d
        n = n - np.stack([(c * e[..., 0] - b * e[..., 1]) / det, (a * e[..., 1] - b * e[..., 0]) / det], axis=-1)
        n = np.clip(n, -REACH, REACH)
        if float(np.abs(e).max(initial=0.0)) < 1e-13:
            break
    # beyond the first turning point of the radial map a pixel has no ray of its own
    good = (np.abs(_brown(n, dist) - d) <= 1e-10).all(axis=-1) & ((n**2).sum(axis=-1) < limit**2)
    return np.asarray(np.where(good[..., None], n, np.nan))
