"""Products and inverses of small matrices by sums in a fixed order; a BLAS's last bits depend on the processor."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped


def product(a: Array, b: Array) -> Real[Array, "... n m"]:
    """Products a · b of matrices (..., n, m) and (..., m, k)."""
    return np.asarray((a[..., :, :, None] * b[..., None, :, :]).sum(axis=-2))


def inverse(m: Array) -> Array:
    """Inverses of matrices (..., 2, 2) or (3, 3), by cofactors. Raises LinAlgError where a determinant is 0."""
    if m.shape[-1] == 2:
        a, b, c, d = m[..., 0, 0], m[..., 0, 1], m[..., 1, 0], m[..., 1, 1]
        cofactors, det = np.empty(m.shape), np.asarray(a * d - b * c)
        cofactors[..., 0, 0], cofactors[..., 0, 1], cofactors[..., 1, 0], cofactors[..., 1, 1] = d, -b, -c, a
    else:
        one, two, three = m.tolist()
        first = _cross(two, three)
        cofactors = np.array(list(zip(first, _cross(three, one), _cross(one, two), strict=True)))
        det = np.asarray(
            one[0] * first[0] + one[1] * first[1] + one[2] * first[2]
        )  # not `sum`, which compensates rounding in newer Pythons
    if (det == 0).any():
        raise np.linalg.LinAlgError("singular matrix")
    return np.asarray(cofactors / det[..., None, None])


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def affine(src: Shaped[Array, "n 2"], dst: Real[Array, "n 2"]) -> Real[Array, "2 3"]:
    """Least-squares affine map (2, 3) from `src` (N, 2) to `dst` (N, 2): `dst` = map[:, :2] · `src` + map[:, 2].

    Collinear points don't determine the map across their line; its derivative in that direction is then zero. Raises
    LinAlgError if all of `src` coincide or points are not finite.
    """
    middle, to = src.mean(axis=0), dst.mean(axis=0)
    off = (src - middle).T
    normal = product(off, off.T)
    linear = product(inverse(normal + 1e-13 * np.trace(normal) * np.eye(2)), product(off, dst - to)).T
    out = np.column_stack([linear, to - (linear * middle).sum(axis=1)])
    if not np.isfinite(out).all():
        raise np.linalg.LinAlgError("affine map: points are not finite")
    return out
