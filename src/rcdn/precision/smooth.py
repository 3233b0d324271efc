"""What the corners of one board know of each other: a smooth sheet seen through a smooth lens.

A board is a homography plus smooth departures (lens, bend) plus what is smooth no more (paper, print). All three get a
normal prior, whose widths are chosen for each board by marginal likelihood: on a flat board the departures vanish and
every corner learns from all others; where corners lie truly unevenly, the third part takes over and they stay put.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg.lapack import dpotrf

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array

LEAST_CORNERS, LEAST_LINES = 16, 4
"""a smaller board says too little of its own smoothness"""
DEGREE, TOTAL = 9, 10
"""of the polynomials that depart from the homography: along one axis, together"""
WIDTHS = (0.02, 0.06, 0.2, 0.6, 2.0, 6.0, 20.0, 60.0, 200.0)
"""standard deviations of quadratic departures that are tried, × the median uncertainty of a corner"""
DECAYS = (0.15, 0.35, 0.7, 1.0)
"""by which they fall from degree to degree"""
ROUGH = (0.0, 0.3, 0.6, 1.0, 2.0, 4.0)
"""standard deviations of unevenness that are tried, × the median uncertainty"""
FREE = 1e3
"""standard deviation of the homography's parameters, × the median uncertainty"""
MISFIT = 3.5
"""standard deviations off the smooth board beyond which a corner doesn't belong to it"""

_Spot = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class _Choice:
    """The likeliest widths: unevenness `rough` px, prior `root` (D,) of the coefficients, and `gram` (D + 1, D + 1) of `_whitened`."""

    rough: float
    root: Array
    gram: Array

    def posterior(self) -> tuple[Array, Array]:
        """Mean (D,) and covariance (D, D) of the coefficients."""
        matrix = np.eye(len(self.root)) + self.root[:, None] * self.gram[:-1, :-1] * self.root
        spread = self.root[:, None] * np.linalg.inv(matrix) * self.root
        return spread @ self.gram[:-1, -1], spread


def smooth(ij: Array, xy: Array, cov: Array, trusted: Array) -> tuple[Array, Array]:
    """Posterior positions (N, 2) px and covariances (N, 2, 2) px² of a board's corners.

    `ij` (N, 2) labels; `xy` (N, 2) px with independent errors of `cov` (N, 2, 2) px². Only `trusted` (N,) corners that
    also fit the rest take part; the others stay, those that don't fit with a covariance that allows for it. Everything stays
    as it came if the board is too small to tell.
    """
    use, spread = trusted.copy(), cov.copy()
    for again in (True, False):
        lines = [len(np.unique(ij[use, k])) for k in (0, 1)]
        if use.sum() < LEAST_CORNERS or min(lines) < LEAST_LINES:
            return xy, cov
        flat, off, (known, noise) = _posterior(ij[use], xy[use], cov[use])
        alien = np.einsum("na,nab,nb->n", off, np.linalg.inv(noise), off) > 2 * MISFIT**2
        if not alien.any() or not again:
            break
        out = np.flatnonzero(use)[alien]
        spread[out] += (np.linalg.norm(off[alien], axis=1) ** 2 / 4)[:, None, None] * np.eye(2)
        use[out] = False
    moved = xy.copy()
    moved[use], spread[use] = flat, known
    return moved, spread


def _posterior(ij: Array, xy: Array, cov: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    """Positions, distances of the data from the smooth board, and covariances of both."""
    base, design, degree = _design(ij, xy)
    scale = float(np.sqrt(np.median(np.trace(cov, axis1=1, axis2=2)) / 2))
    best = _likeliest(design, degree, xy - base, cov, scale)
    coefficient, spread = best.posterior()
    flat = design @ coefficient
    known = (design.reshape(-1, len(spread)) @ spread).reshape(design.shape) @ design.swapaxes(1, 2)
    noise = cov + best.rough**2 * np.eye(2)
    stay = best.rough**2 * np.linalg.inv(noise)
    go = np.eye(2) - stay
    off = xy - base - flat
    moved = base + flat + np.einsum("nab,nb->na", stay, off)
    return moved, off, (stay @ cov + go @ known @ go.swapaxes(1, 2), noise)


def _design(ij: Array, xy: Array) -> tuple[Array, Array, Array]:
    """A homography's positions (N, 2), and columns (N, 2, D) of what may change them, with the degree (D,) of each.

    Degree 0: the eight parameters of the homography; from 2 on: orthonormal polynomials of the labels, px.
    """
    H = homography(ij, xy)
    points = ij.astype(float)
    base = apply_homography(H, points)
    depth = (points @ H[2, :2] + H[2, 2])[:, None]
    row = np.column_stack([points, np.ones(len(points))]) / depth * abs(float(np.median(depth)))
    zero = np.zeros_like(row)
    tangent = np.stack([
        np.concatenate([row, zero, -base[:, :1] * row[:, :2]], axis=1),
        np.concatenate([zero, row, -base[:, 1:] * row[:, :2]], axis=1),
    ], axis=1)  # fmt: skip
    tangent = np.linalg.qr(tangent.reshape(-1, 8))[0].reshape(-1, 2, 8) * np.sqrt(len(points))
    at = 2 * (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1) - 1
    one, two = (legvander(at[:, k], min(DEGREE, int(np.ptp(ij[:, k])))) for k in (0, 1))
    pairs = [(a, b) for a in range(one.shape[1]) for b in range(two.shape[1]) if 2 <= a + b <= TOTAL]
    bent = np.stack([one[:, a] * two[:, b] * np.sqrt((2 * a + 1) * (2 * b + 1)) for a, b in pairs], axis=1)
    both = np.concatenate([np.stack([bent, 0 * bent], axis=1), np.stack([0 * bent, bent], axis=1)], axis=2)
    order = np.array([a + b for a, b in pairs])
    return base, np.concatenate([tangent, both], axis=2), np.concatenate([np.zeros(8, int), order, order])


def _likeliest(design: Array, degree: Array, off: Array, cov: Array, scale: float) -> _Choice:
    """The widths with the largest marginal likelihood: a coarse grid, then the best of its neighbours, again and again."""
    grid = tuple(itertools.product(range(0, len(ROUGH), 2), range(0, len(DECAYS), 2), range(0, len(WIDTHS), 2)))
    whitened = functools.cache(lambda k: _whitened(design, off, cov, ROUGH[k] * scale))
    likelihood = functools.cache(lambda at: _evidence(*whitened(at[0]), _root(degree, at, scale)))

    best = max(grid, key=likelihood)
    while True:
        a, b, c = best
        steps = [(a - 1, b, c), (a + 1, b, c), (a, b - 1, c), (a, b + 1, c), (a, b, c - 1), (a, b, c + 1)]
        lengths = (len(ROUGH), len(DECAYS), len(WIDTHS))
        near = [s for s in steps if all(0 <= n < length for n, length in zip(s, lengths, strict=True))]
        after = max([best, *near], key=likelihood)
        if after == best:
            return _Choice(ROUGH[a] * scale, _root(degree, best, scale), whitened(a)[0])
        best = after


def _root(degree: Array, at: _Spot, scale: float) -> Array:
    """Prior standard deviations of all coefficients, px."""
    return scale * np.where(degree > 0, WIDTHS[at[2]] * DECAYS[at[1]] ** (degree - 2.0), FREE)


def _whitened(design: Array, off: Array, cov: Array, rough: float) -> tuple[Array, float]:
    """Normal matrix of the coefficients under noise `cov` and unevenness, with their right side and sum of squares below it, and a constant.

    (D + 1, D + 1): what is left of the last diagonal element after elimination is the squared distance to the best fit, and one.
    """
    white = np.linalg.inv(np.linalg.cholesky(cov + rough**2 * np.eye(2)))
    A = (white @ design).reshape(-1, design.shape[2])
    y = (white @ off[..., None]).reshape(-1, 1)
    both = np.concatenate([A, y], axis=1)
    return both.T @ both, 0.5 + float(np.log(np.diagonal(white, axis1=1, axis2=2)).sum())


def _evidence(gram: Array, fixed: float, root: Array) -> float:
    """Log marginal likelihood of the data, but for a constant."""
    scale = np.append(root, 1)
    factor = dpotrf(scale[:, None] * gram * scale + np.eye(len(scale)), lower=1)[0].diagonal()
    return -0.5 * float(factor[-1] ** 2) - float(np.log(factor[:-1]).sum()) + fixed
