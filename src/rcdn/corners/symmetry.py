"""The centre of point symmetry, or of antisymmetry, of a corner's surroundings.

Two straight edges that cross look the same after half a turn about their crossing, whatever their angle, contrast and
(even) blur; perspective keeps that, until the window meets the next edges. Equating I(c + d) and I(c − d) over a window
uses the whole length of the edges, not only the middle, and no model of the grey levels: with white noise and known
gradients its variance is the bound for any estimator of the crossing. Schöps et al. 2020 ("Why having 10,000 parameters
in your camera model is better than twelve"), section 3, use the same cost with a homography from the known board.

Where three edges cross, as in a deltille, opposite sectors have opposite colours, and half a turn gives the negative: I(c + d) + I(c − d)
is the same for all d. What it is the same as is no business of the estimate: the mean over the window is taken out.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.corners.patches import chunks, gather
from rcdn.types import Array

BLUR = 1.0
"""Smoothing before the comparison, px: it makes linear interpolation harmless and the gradients usable in noise."""
MARGIN = 4
"""Reach of the smoothing, px."""
THIN = 0.004
"""Smallest ratio of the two eigenvalues of the normal matrix; below it the window shows an edge."""


@lru_cache(maxsize=64)
def _smoother(size: int) -> Array:
    """(size, size + 2 MARGIN) matrix that smooths a row of pixels and drops its ends."""
    kernel = np.exp(-0.5 * (np.arange(-MARGIN, MARGIN + 1) / BLUR) ** 2)
    out = np.zeros((size, size + 2 * MARGIN), np.float32)
    for row in range(size):
        out[row, row : row + 2 * MARGIN + 1] = kernel / kernel.sum()
    return out


@lru_cache(maxsize=64)
def _disc(half: int) -> Array:
    square = np.arange(-half, half + 1) ** 2
    return ((square[:, None] + square) <= (half + 0.5) ** 2).astype(np.float32)


def _windows(grey: Array, xy: Array, half: int) -> Array:
    """Smoothed `grey` at `xy` (N, 2) plus every offset up to `half`: (N, 2 half + 1, 2 half + 1), float32."""
    whole = np.floor(xy).astype(np.int64)
    raw = gather(grey, whole, half + 1 + MARGIN)[:, 1:, 1:].astype(np.float32)
    smooth = _smoother(raw.shape[1] - 2 * MARGIN)
    window = smooth @ raw @ smooth.T
    fx, fy = (xy - whole).astype(np.float32).T[:, :, None, None]
    window = window[:, :, :-1] * (1 - fx) + window[:, :, 1:] * fx
    return window[:, :-1] * (1 - fy) + window[:, 1:] * fy


def _odd(values: Array, half: int) -> Array:
    return values - values[:, ::-1, ::-1]


def _even(values: Array, half: int) -> Array:
    """Values plus their half turn, without their mean over the disc."""
    both, disc = values + values[:, ::-1, ::-1], _disc(half)
    return np.asarray(both - (both * disc).sum(axis=(1, 2), keepdims=True) / disc.sum())


def symmetry_step(grey: Array, xy: Array, half: int, anti: bool = False) -> Array:
    """One Gauss–Newton step (N, 2), px, from `xy` (N, 2) towards the centre of symmetry (`anti`: antisymmetry) within `half` px.

    NaN where the window has no edges, or edges of one direction only.
    """
    window = _windows(grey, xy, half + 1)
    turn = _even if anti else _odd
    residual = turn(window[:, 1:-1, 1:-1], half)
    gx = turn(window[:, 1:-1, 2:] - window[:, 1:-1, :-2], half) * (0.5 * _disc(half))
    gy = turn(window[:, 2:, 1:-1] - window[:, :-2, 1:-1], half) * (0.5 * _disc(half))
    dot = lambda a, b: np.einsum("nij,nij->n", a, b).astype(np.float64)  # noqa: E731
    xx, xy_, yy, x0, y0 = dot(gx, gx), dot(gx, gy), dot(gy, gy), dot(gx, residual), dot(gy, residual)
    det = xx * yy - xy_ * xy_
    det = np.where(det > THIN * (xx + yy) ** 2, det, np.nan)
    return np.stack((xy_ * y0 - yy * x0, xy_ * x0 - xx * y0), axis=1) / det[:, None]


def symmetry_centre(
    grey: Array, start: Array, half: int, repeats: int = 10, done: float = 0.003, anti: bool = False
) -> Array:
    """Centres of symmetry (N, 2) px of `grey` (H, W) near `start` (N, 2) px, over discs of radius `half`, px; `anti`: of antisymmetry.

    Steps of at most 1 px until they are shorter than `done`. NaN where a step fails, where there is no rest after
    `repeats` steps, or where the centre is more than max(1, half / 2) px from the start.
    """
    xy = np.array(start, dtype=np.float64)
    for part in chunks(len(xy), (2 * (half + MARGIN) + 3) ** 2 * 4):
        moving = np.arange(len(xy))[part]
        for _ in range(repeats):
            step = np.clip(symmetry_step(grey, xy[moving], half, anti), -1, 1)
            xy[moving] += step
            moving = moving[(np.abs(step) > done).any(axis=1)]
            if not len(moving):
                break
        xy[moving] = np.nan
    xy[~(np.abs(xy - start) <= max(1.0, 0.5 * half)).all(axis=1)] = np.nan
    return xy
