"""Edge directions of corners from a histogram of gradients: the paper's method (section 3.4). `orientation` has rcdn's
own."""

from __future__ import annotations

import numpy as np

from rcdn.corners.patches import chunks, gather
from rcdn.types import Array
from rcdn.types.arrays import Real

BINS = 32
"""bins of edge directions in [0, π)"""
BEFORE, AFTER = 10, 9
"""The window of 20 × 20 px, as offsets from the rounded corner: a window of even size has no middle pixel."""
SMOOTH = np.array([1, 4, 6, 4, 1]) / 16
"""Weights that smooth the histogram around the circle."""
LEAST_WEIGHT = 0.25
"""Least height of a maximum, share of the strongest one."""
MOST_DIRECTIONS = 4
"""Number of directions returned; a corner with more can't start a board."""


def edge_directions(grey: Array, xy: Real[Array, "n 2"]) -> tuple[Array, Array]:
    """Edge directions of corners at `xy` (N, 2) px of `grey` (H, W; uint8 or float).

    Paper section 3.4: the local maxima of the gradient histogram of the 20 × 20 window. The histogram has 32 bins of
    edge directions (gradient + π/2) weighted by the gradient's length (Sobel) and smoothed around the circle by
    [1 4 6 4 1]/16; a parabola through a maximum and its neighbours places it between the bins. Returns `angles` (N, 4),
    radians in [0, π), the four strongest by falling weight, NaN where there are fewer; and `count` (N,), how many
    maxima there are: an ideal X-corner has 2, a flat window none. Outside the image the border pixels are repeated.
    Never fails.
    """
    xy = np.asarray(xy, np.float64).reshape(-1, 2)
    angles, count = np.full((len(xy), MOST_DIRECTIONS), np.nan), np.zeros(len(xy), int)
    centres = np.rint(xy).astype(int)
    for part in chunks(len(xy), (BEFORE + AFTER + 3) ** 2):
        histogram = _histograms(gather(grey, centres[part], BEFORE + 1).astype(np.float32))
        angles[part], count[part] = _maxima(histogram)
    return angles, count


def _histograms(windows: Array) -> Array:
    """Smoothed histograms (N, BINS) of windows (N, 23, 23), which include the margin of one pixel that the gradients
    need."""
    end = BEFORE + AFTER + 3
    w = windows[:, :end, :end]
    dx, dy = w[:, :, 2:] - w[:, :, :-2], w[:, 2:] - w[:, :-2]
    gx = dx[:, :-2] + 2 * dx[:, 1:-1] + dx[:, 2:]
    gy = dy[:, :, :-2] + 2 * dy[:, :, 1:-1] + dy[:, :, 2:]
    edge = (np.arctan2(gy, gx) + np.pi / 2) % np.pi
    index = np.minimum((edge * (BINS / np.pi)).astype(int), BINS - 1) + BINS * np.arange(len(w))[:, None, None]
    weight = np.hypot(gx, gy)
    raw = np.bincount(index.ravel(), weight.ravel(), BINS * len(w)).reshape(-1, BINS)
    return np.asarray(sum(s * np.roll(raw, k - 2, axis=1) for k, s in enumerate(SMOOTH)))


def _maxima(histogram: Array) -> tuple[Array, Array]:
    """Angles (N, MOST_DIRECTIONS) by falling weight, NaN-padded, and the number (N,) of maxima."""
    before, after = np.roll(histogram, 1, axis=1), np.roll(histogram, -1, axis=1)
    top = histogram.max(axis=1, keepdims=True)
    peak = (histogram > before) & (histogram >= after) & (histogram >= LEAST_WEIGHT * top)
    curve = before - 2 * histogram + after
    shift = np.divide(before - after, 2 * curve, out=np.zeros_like(curve), where=peak & (curve < 0))
    angle = (np.arange(BINS) + 0.5 + shift) * (np.pi / BINS) % np.pi
    strongest = np.argsort(-np.where(peak, histogram, -1), axis=1, kind="stable")[:, :MOST_DIRECTIONS]
    rows = np.arange(len(histogram))[:, None]
    return np.where(peak[rows, strongest], angle[rows, strongest], np.nan), peak.sum(axis=1)
