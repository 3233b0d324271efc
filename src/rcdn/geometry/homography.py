"""The only homography."""

from __future__ import annotations

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array


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
