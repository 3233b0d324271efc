"""Homographies, lens models and poses. The only place where any of them lives."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array, Camera, Pose


def homography(src: Array, dst: Array) -> Array:
    """Homography (3, 3) that takes `src` (N, 2) to `dst` (N, 2), N ≥ 4, by the normalised DLT (Hartley 1997).

    Least squares in the algebraic error for N > 4. Raises RcdnError if fewer than 4 points are given.
    """
    src, dst = np.asarray(src, float), np.asarray(dst, float)
    if len(src) < 4 or src.shape != dst.shape:
        raise RcdnError("homography: src and dst must be (N, 2) arrays of the same N ≥ 4")
    Ts, Td = _normaliser(src), _normaliser(dst)
    p, q = apply_homography(Ts, src), apply_homography(Td, dst)
    zero, one = np.zeros(len(p)), np.ones(len(p))
    x, y, u, v = p[:, 0], p[:, 1], q[:, 0], q[:, 1]
    rows = np.concatenate([
        np.stack([x, y, one, zero, zero, zero, -u * x, -u * y, -u], axis=1),
        np.stack([zero, zero, zero, x, y, one, -v * x, -v * y, -v], axis=1),
    ])  # fmt: skip
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
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
    """Camera points (..., 3) to pixels (..., 2). Points with z ≤ 0 give NaN (but for `fisheye`, which sees behind itself)."""
    points = np.asarray(points, float)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.model == "fisheye":
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        scale = np.where(r > 1e-12, _kb(theta, camera.distortion) / np.maximum(r, 1e-12), 1.0)
        d = np.stack([x * scale, y * scale], axis=-1)
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            n = np.where((z > 0)[..., None], points[..., :2] / z[..., None], np.nan)
        d = n if camera.model == "pinhole" else _brown(n, camera.distortion)
    return d @ camera.K[:2, :2].T + camera.K[:2, 2]


def unproject(camera: Camera, pixels: Array) -> Array:
    """Pixels (..., 2) to viewing rays (..., 3) of unit z (`fisheye`: unit length). Exact to 1e-10 where the lens model can be inverted, else NaN."""
    pixels = np.asarray(pixels, float)
    K = camera.K
    y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
    d = np.stack([(pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)
    if camera.model == "fisheye":
        return _fisheye_ray(d, camera.distortion)
    n = d if camera.model == "pinhole" else _brown_inverse(d, camera.distortion)
    return np.concatenate([n, np.ones_like(n[..., :1])], axis=-1)


def _kb(theta: Array, k: Array) -> Array:
    t2 = theta * theta
    return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))


def _fisheye_ray(d: Array, k: Array) -> Array:
    r = np.hypot(d[..., 0], d[..., 1])
    theta = np.minimum(r, np.pi)
    for _ in range(20):
        t2 = theta * theta
        slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
        theta = theta - (_kb(theta, k) - r) / np.where(np.abs(slope) > 1e-3, slope, 1e-3)
        theta = np.clip(theta, 0, np.pi)
    theta = np.where(np.abs(_kb(theta, k) - r) < 1e-10 * (1 + r), theta, np.nan)
    s = np.where(r > 1e-12, np.sin(theta) / np.maximum(r, 1e-12), 1.0)
    return np.stack([d[..., 0] * s, d[..., 1] * s, np.cos(theta)], axis=-1)


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
    """Newton in two unknowns from the distorted point; NaN beyond the fold of the polynomial."""
    k1, k2, p1, p2 = dist[:4]
    k3 = dist[4] if len(dist) > 4 else 0.0
    n = d.copy()
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
        n = np.clip(n, -20, 20)
        if float(np.abs(e).max(initial=0.0)) < 1e-13:
            break
    bad = (np.abs(_brown(n, dist) - d) > 1e-10).any(axis=-1) | ~_within_fold(n, k1, k2, k3)
    return np.where(bad[..., None], np.nan, n)


def _within_fold(n: Array, k1: float, k2: float, k3: float) -> Array:
    """True where the radial map still grows: beyond its first turning point a pixel has no ray of its own."""
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    real = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)].real
    limit = float(real.min()) if len(real) else np.inf
    return np.asarray((n**2).sum(axis=-1) < limit)
