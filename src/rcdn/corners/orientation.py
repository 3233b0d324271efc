"""Edge directions of corners from the grey levels on rings around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from rcdn.corners.blurred_axes import blurred_axes
from rcdn.types import Array

HALF_TURN = 48
"""Directions in [0, π) at which the rings are sampled."""
RINGS = (0.8, 1.0, 1.2)
"""Radii of the rings, shares of the radius that is asked for. Smaller ones see more blur than direction."""
MIN_FIT = 0.2
"""Below this `fit` there are no axes; an ideal L-junction has 1/3, T-junctions and edges less."""
MIN_CONTRAST = 1.0
"""Smallest difference of the sectors, grey levels."""
BATCH = 512
"""Corners at a time: what they need at once fits into a core's cache."""


@dataclass(frozen=True, eq=False)
class Orientation:
    """What the rings around N corners show.

    `axes` (N, 2) the two edge directions a < b, radians in [0, π), x right and y down; NaN where there aren't two.
    `contrast` (N,) difference of the sectors' means, grey levels, ≥ 0. `polarity` (N,) int8: +1 where the sector from
    a to b (rising angle) is the brighter one, −1 where it is the darker one, 0 without axes. `fit` (N,) in [0, 1]:
    share of the rings' variance that an X-corner explains.
    """

    axes: Array
    contrast: Array
    polarity: Array
    fit: Array


def axes(grey: Array, xy: Array, radius: Array, careful: Array | None = None) -> Orientation:
    """Edge directions, contrast and polarity of corners at `xy` (N, 2) px of `grey` (H, W; uint8 or float).

    `radius` (N,) px, or one number, about a third of the pitch: rings at 0.8, 1 and 1.2 times that should stay within
    the adjacent squares. On a ring an X-corner has s(φ + π) = s(φ) and two levels. Opposite directions are averaged,
    which cancels a small error of `xy`; the pair of directions with the largest variance between its two sectors is the
    start of a fit that knows of blur (`blurred_axes`). What isn't symmetric lowers `fit`, so that edges and L- and
    T-junctions score low. Outside the image the border pixels are repeated. `careful` (N,) bool: corners whose axes get that fit (None: all);
    the others keep the start, good to a few degrees.
    """
    xy = np.asarray(xy, np.float64).reshape(-1, 2)
    radius = np.broadcast_to(np.asarray(radius, np.float64), len(xy))
    careful = np.ones(len(xy), bool) if careful is None else careful
    parts = [
        _orient(grey, xy[part], radius[part, None] * np.array(RINGS), careful[part])
        for part in (slice(i, i + BATCH) for i in range(0, len(xy), BATCH))
    ]
    if not parts:
        return Orientation(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int8), np.zeros(0))
    found, contrast, polarity, fit = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Orientation(found, contrast, polarity, fit)


def _orient(grey: Array, xy: Array, radius: Array, careful: Array) -> tuple[Array, Array, Array, Array]:
    """Axes, contrast, polarity and fit of corners at `xy` (N, 2) from rings of `radius` (N, R) px."""
    rings = sample_rings(grey, xy, radius)
    ok, start, contrast, fit = _sectors(rings.mean(axis=1))
    folded = (rings[..., :HALF_TURN] + rings[..., HALF_TURN:]) / 2
    fit_too = ok & careful
    start[fit_too] = blurred_axes(folded[fit_too], radius[fit_too], start[fit_too])
    found = start % np.pi
    swapped = found[:, 0] > found[:, 1]
    polarity = np.where(ok, np.sign(contrast) * np.where(swapped, -1, 1), 0).astype(np.int8)
    return np.where(ok[:, None], np.sort(found, axis=1), np.nan), np.abs(contrast), polarity, fit


def sample_rings(grey: Array, xy: Array, radius: Array) -> Array:
    """Grey levels (N, R, 2 HALF_TURN) float32 on rings of `radius` (N, R) px, at directions 0, π / HALF_TURN, …"""
    angle = np.arange(2 * HALF_TURN) * (np.pi / HALF_TURN)
    there = np.nan_to_num(xy, nan=-1)
    # only the part of the picture that the rings touch is converted
    low = np.clip(
        np.floor((there - radius.max(axis=1)[:, None]).min(axis=0)).astype(int) - 1, 0, np.array(grey.shape[::-1]) - 1
    )
    high = np.maximum(np.ceil((there + radius.max(axis=1)[:, None]).max(axis=0)).astype(int) + 2, low + 1)
    part = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]], np.float32)
    start, length = (there - low).astype(np.float32)[..., None, None], radius.astype(np.float32)[..., None]
    x = (start[:, 0] + length * np.cos(angle).astype(np.float32)).reshape(len(xy), -1)
    y = (start[:, 1] + length * np.sin(angle).astype(np.float32)).reshape(len(xy), -1)
    sampled = cv2.remap(part, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled).reshape(*radius.shape, -1)


@lru_cache(maxsize=1)
def _pairs() -> tuple[Array, Array, Array]:
    """All pairs a < b of bin boundaries, and (HALF_TURN, pairs) what sums a centred signal from a to b, scaled so that squares tell the
    variance between the two sectors."""
    a, b = np.triu_indices(HALF_TURN, k=1)
    bins = np.arange(HALF_TURN)[:, None]
    inside = (bins >= a) & (bins < b)
    return a, b, (inside / np.sqrt((b - a) * (HALF_TURN - (b - a)))).astype(np.float32)


def _sectors(signal: Array) -> tuple[Array, Array, Array, Array]:
    """The two sectors that explain most of the mean ring signals (N, 2 HALF_TURN).

    Returns whether there are two; their boundaries (N, 2), radians, a < b < a + π; the signed contrast (positive: the
    sector from a to b is brighter); and the fit.
    """
    first, second = signal[:, :HALF_TURN], signal[:, HALF_TURN:]
    folded = (first + second) / 2
    folded = folded - folded.mean(axis=1, keepdims=True)
    energy = ((folded**2).sum(axis=1) + ((first - second) ** 2).sum(axis=1) / 4).astype(np.float64)
    a, b, sums = _pairs()
    between = folded @ sums
    best = np.abs(between).argmax(axis=1)
    a, b = a[best], b[best]
    peak = between[np.arange(len(folded)), best].astype(np.float64)
    fit = np.divide(peak**2 * HALF_TURN, energy, out=np.zeros(len(peak)), where=energy > 0)
    contrast = peak * HALF_TURN / np.sqrt((b - a) * (HALF_TURN - (b - a)))
    ok = (fit >= MIN_FIT) & (np.abs(contrast) >= MIN_CONTRAST)
    start = (np.stack((a, b), axis=1) - 0.5) * (np.pi / HALF_TURN)
    return ok, start, contrast, np.minimum(fit, 1)
