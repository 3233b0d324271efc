"""Saddle points of the grey surface: least-squares quadratic fits, for many corners at once.

Smoothing, window weights and the fit are all linear, so that one precomputed matrix acts on the raw pixels around a
corner: nothing is computed elsewhere in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rcdn.corners.patches import plain
from rcdn.geometry.elementary import exp
from rcdn.geometry.matrices import inverse, product
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

_kernel = bind("rcdn_surface_fit")


@dataclass(frozen=True, eq=False)
class Fit:
    """A surface fit: `half` window, px; `matrix` (5, n): raw pixels within `reach` px → a1..a5 of
    a1 x² + a2 xy + a3 y² + a4 x + a5 y + a6."""

    half: int
    reach: int
    matrix: Array
    slack: float
    """A result within this distance of the window's centre is accepted, px; otherwise the window moves."""
    repeats: int


@lru_cache(maxsize=32)
def rochade(half: int) -> Fit:
    """The fit of the paper's surface fitting (Placht et al. 2014, section 2.2): cone of half size `half`, no weights.

    The paper's window is 5×5 (half 2). It moves by whole pixels, at most three times, if the saddle is over 1 px away.
    """
    reach = np.arange(-half, half + 1)
    cone = np.maximum(0, half + 1 - np.sqrt(reach[:, None] ** 2 + reach**2))
    return Fit(half, 2 * half, _matrix(np.ones((2 * half + 1, 2 * half + 1)), cone / cone.sum()), 1.0, 3)


@lru_cache(maxsize=32)
def smooth_fit(half: int) -> Fit:
    """A fit less sensitive to noise and blur: Gaussian smoothing and weights in proportion to `half`; moves ≤ 6 times.

    Smoothing 0.35 half (at least 0.7 px), weights 0.5 half: measured best of 0.25–0.4 and 0.5–0.7 over squares of
    6–40 px, blur 0.7–4 px, noise 0–40 and tilts up to 70°.
    """
    sigma = max(0.7, 0.35 * half)
    grow = int(np.ceil(3 * sigma))
    kernel = _gaussian(grow, sigma)
    matrix = _matrix(_gaussian(half, 0.5 * half), kernel / kernel.sum())
    return Fit(half, half + grow, matrix, 0.5, 6)


def _gaussian(half: int, sigma: float) -> Array:
    square = np.arange(-half, half + 1.0) ** 2
    return exp(-(square[:, None] + square) / (2 * sigma * sigma))


def _matrix(weights: Array, kernel: Array) -> Real[Array, "5 n"]:
    """(5, n): raw window → a1..a5 (`Fit`), fitted with symmetric `weights` after smoothing by `kernel`."""
    half = len(weights) // 2
    y, x = (v.ravel().astype(float) for v in np.mgrid[-half : half + 1, -half : half + 1])
    w = weights.ravel()
    even = np.stack(
        (x * x, y * y, np.ones_like(x))
    )  # with weights symmetric along x and along y, all other terms are orthogonal
    a1, a3, _ = product(inverse(product(even * w, even.T)), even * w)
    a2, a4, a5 = (w * odd / (w * odd * odd).sum() for odd in (x * y, x, y))
    solver = np.reshape((a1, a2, a3, a4, a5), (5, *weights.shape))
    side, more = len(weights), len(kernel)
    out = np.zeros((5, side + more - 1, side + more - 1))
    for j, i in np.ndindex(kernel.shape):
        out[:, j : j + side, i : i + side] += kernel[j, i] * solver
    return out.reshape(5, -1)


def surface_fit(grey: Array, seeds: Shaped[Array, "n 2"], fit: Fit) -> Real[Array, "n 2"]:
    """Saddles (N, 2) px of `grey` (H, W; uint8 or float) near integer `seeds` (N, 2); NaN where the fit fails.

    SPEC 5.1 after ROCHADE. Where the saddle is more than `fit.slack` from the window's centre, the window moves to the
    nearest pixel and the fit is repeated, at most `fit.repeats` times. The border pixels are repeated outside the
    image. Failures: the determinant D = 4 a1 a3 − a2² isn't negative, one curvature is nearly zero (an edge), the
    window is flat, the saddle lies outside the window, the last repeat hasn't converged, or the result is more than 2
    `fit.half` from the seed and so belongs to another corner.
    """
    seeds = np.asarray(seeds).reshape(-1, 2)
    return surface_fits(grey, seeds, (fit,), np.zeros(len(seeds), np.int64))


def surface_fits(grey: Array, seeds: Array, fits: tuple[Fit, ...], which: Int[Array, " n"]) -> Array:
    """As `surface_fit`, with the fit `fits[which]` for each corner, `which` (N,)."""
    seeds = np.ascontiguousarray(seeds, np.int64).reshape(-1, 2)
    xy = np.empty(seeds.shape)
    matrices, first, sizes, slack, room = _tables(fits)
    window = np.empty(room, np.float32)
    _kernel(plain(grey), seeds, np.asarray(which, np.int64), matrices, first, sizes, slack, window, xy)
    return xy


@lru_cache(maxsize=32)
def _tables(fits: tuple[Fit, ...]) -> tuple[Array, Array, Array, Array, int]:
    """`fits` as arguments of the kernel: all matrices concatenated, their offsets, sizes and slacks, and the size of
    the largest window."""
    ends = np.cumsum([fit.matrix.size for fit in fits])
    return (
        np.concatenate([fit.matrix.ravel() for fit in fits]),
        np.array([end - fit.matrix.size for end, fit in zip(ends, fits, strict=True)], np.int64),
        np.array([(fit.half, fit.reach, fit.repeats) for fit in fits], np.int64),
        np.array([fit.slack for fit in fits]),
        max(fit.matrix.shape[1] for fit in fits),
    )
