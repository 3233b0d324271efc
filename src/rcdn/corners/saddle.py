"""Saddle points of the grey surface: least-squares quadratic fits, for many corners at once.

Smoothing, window weights and the fit are all linear, so they are one precomputed matrix that acts on the raw pixels
around a corner: nothing is computed elsewhere in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import convolve2d

from rcdn.corners.patches import chunks, gather
from rcdn.types import Array

FLATNESS = 0.004
"""Smallest ratio of the two curvatures of a saddle; a corner whose edges cross at θ has tan²(θ/2): 7° here."""
FAINT = 0.01
"""Smallest rise of the fitted saddle from the middle to the side of its window, grey levels."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A surface fit: `half` window, px; `matrix` (6, n) from the raw pixels within `reach` px to the coefficients."""

    half: int
    reach: int
    matrix: Array
    slack: float
    """A result within this distance of the window's centre stands, px; otherwise the window moves."""
    repeats: int


@lru_cache(maxsize=32)
def rochade(half: int) -> Fit:
    """The fit of the paper's surface fitting (Placht et al. 2014, section 2.2): cone of half size `half`, no weights.

    The paper says 5×5 (half 2). The window moves by whole pixels at most three times, if the saddle is over 1 px away.
    """
    reach = np.arange(-half, half + 1)
    cone = np.maximum(0, half + 1 - np.hypot(reach[:, None], reach))
    return Fit(half, 2 * half, _matrix(np.ones((2 * half + 1, 2 * half + 1)), cone / cone.sum()), 1.0, 3)


@lru_cache(maxsize=32)
def smooth_fit(half: int) -> Fit:
    """A fit that noise and blur move less: Gaussian smoothing and weights in proportion to `half`; moves ≤ 6 times.

    Smoothing 0.35 half (at least 0.7 px), weights 0.5 half: measured best of 0.25–0.4 and 0.5–0.7 over squares of
    6–40 px, blur 0.7–4 px, noise 0–40 and tilts up to 70°.
    """
    sigma = max(0.7, 0.35 * half)
    grow = int(np.ceil(3 * sigma))
    kernel = _gaussian(grow, sigma)
    matrix = _matrix(_gaussian(half, 0.5 * half), kernel / kernel.sum()).astype(np.float32)
    return Fit(half, half + grow, matrix, 0.5, 6)


def _gaussian(half: int, sigma: float) -> Array:
    square = np.arange(-half, half + 1.0) ** 2
    return np.exp(-(square[:, None] + square) / (2 * sigma**2))


def _matrix(weights: Array, kernel: Array) -> Array:
    """(6, n): raw window → a1..a6 of a1 x² + a2 xy + a3 y² + a4 x + a5 y + a6, fitted after smoothing by `kernel`."""
    half = len(weights) // 2
    y, x = (v.ravel().astype(float) for v in np.mgrid[-half : half + 1, -half : half + 1])
    root = np.sqrt(weights).ravel()
    basis = np.stack((x * x, x * y, y * y, x, y, np.ones_like(x)), axis=1)
    solver = (np.linalg.pinv(basis * root[:, None]) * root).reshape(6, *weights.shape)
    return np.stack([convolve2d(s, kernel) for s in solver]).reshape(6, -1)


def fit_step(grey: Array, centres: Array, fit: Fit) -> Array:
    """Offsets (N, 2), px, from integer `centres` (N, 2) to the saddle of the surface fitted to `grey` (H, W) there.

    NaN where there is no saddle: the determinant D = 4 a1 a3 − a2² isn't negative, one curvature is nearly zero (an
    edge), the window is flat, or the point lies outside the window. The border pixels are repeated outside the image.
    """
    out = np.full((len(centres), 2), np.nan)
    for part in chunks(len(centres), (2 * fit.reach + 1) ** 2):
        window = gather(grey, centres[part], fit.reach).astype(fit.matrix.dtype).reshape(-1, fit.matrix.shape[1])
        if window.dtype == np.float32:  # the level tells nothing of the saddle, and costs digits
            window -= window.mean(axis=1, keepdims=True)
        a1, a2, a3, a4, a5, _ = (fit.matrix @ window.T).astype(np.float64)
        det = 4 * a1 * a3 - a2 * a2
        total = (np.abs(a1 + a3) + np.hypot(a1 - a3, a2)) ** 2  # the square of twice the larger curvature
        ok = (-det > FLATNESS * total) & (total * fit.half**4 > 4 * FAINT**2)
        det = np.where(ok, det, np.nan)
        step = np.stack((a2 * a5 - 2 * a3 * a4, a2 * a4 - 2 * a1 * a5), axis=1) / det[:, None]
        out[part] = np.where((np.abs(step) <= fit.half).all(axis=1, keepdims=True), step, np.nan)
    return out


def surface_fit(grey: Array, seeds: Array, fit: Fit) -> Array:
    """Saddles (N, 2) px of `grey` (H, W; uint8 or float) near integer `seeds` (N, 2); NaN where the fit fails.

    SPEC 5.1 after ROCHADE. Where the saddle is more than `fit.slack` from the window's centre, the window moves to
    the nearest pixel and the fit is repeated, at most `fit.repeats` times. Failures: those of `fit_step`, no rest
    after the last repeat, or more than 2 `fit.half` from the seed, which is another corner's saddle.
    """
    centres = np.array(seeds, dtype=np.int64).reshape(-1, 2)
    step = fit_step(grey, centres, fit)
    for _ in range(fit.repeats):
        far = np.nonzero((np.abs(step) > fit.slack).any(axis=1))[0]
        if not len(far):
            break
        centres[far] += np.rint(step[far]).astype(np.int64)
        step[far] = fit_step(grey, centres[far], fit)
    xy = centres + step
    xy[(np.abs(step) > max(1.0, fit.slack)).any(axis=1) | (np.abs(xy - seeds) > 2 * fit.half).any(axis=1)] = np.nan
    return xy
