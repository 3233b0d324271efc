"""Edge directions of corners from the grey levels on rings around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rcdn.corners.patches import plain
from rcdn.geometry.elementary import cos_sin
from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

HALF_TURN = constants("rings")["DIRECTIONS"]
"""Directions in [0, π) at which the rings are sampled."""
MIN_CONTRAST = 1.0
"""Least difference between the sectors, grey levels."""
_axes = bind("rcdn_axes")
_sample = bind("rcdn_sample_rings")


@dataclass(frozen=True, eq=False)
class Orientation:
    """Edge directions and contrast of N corners, measured on rings around them.

    `axes` (N, 2) the two edge directions a < b, radians in [0, π), x right and y down; NaN where there aren't two.
    `contrast` (N,) difference of the sectors' means, grey levels, ≥ 0. `polarity` (N,) int8: +1 where the sector from
    a to b (rising angle) is the brighter one, −1 where it is the darker one, 0 without axes. `fit` (N,) in [0, 1]:
    share of the rings' variance that an X-corner explains.
    """

    axes: Array
    contrast: Array
    polarity: Array
    fit: Array


def axes(grey: Array, xy: Real[Array, "n 2"], radius: Array, careful: Bool[Array, " n"] | None = None) -> Orientation:
    """Edge directions, contrast and polarity of corners at `xy` (N, 2) px of `grey` (H, W; uint8 or float).

    `radius` (N,) px, or one number, about a third of the pitch: rings at 0.8, 1 and 1.2 times that should stay within
    the adjacent squares. On a ring an X-corner has s(φ + π) = s(φ) and two levels. Opposite directions are averaged,
    which cancels a small error of `xy`; the pair of directions with the largest variance between its two sectors is the
    initial guess of a fit that models blur. Asymmetry lowers `fit`, so that edges and L- and T-junctions score low.
    Outside the image the border pixels are repeated. `careful` (N,) bool: corners whose axes get that fit (None: all);
    the others keep the initial guess, which is accurate to a few degrees.

    The fit is a damped Gauss–Newton on m + c erf(d₁/s) erf(d₂/s), d the distances to the two edges: two blurred
    straight edges that cross. Blur makes the narrow sectors of a tilted corner appear wider than they are, which only a
    model of the blur corrects. m and c are eliminated (variable projection); a weak prior on the blur s decides where
    noise hides it. Where the residual grows or the fit diverges, the initial guess is kept.
    """
    xy = np.ascontiguousarray(xy, np.float64).reshape(-1, 2)
    count = len(xy)
    radius = np.full(count, radius, np.float64) if np.ndim(radius) == 0 else np.ascontiguousarray(radius, np.float64)
    axes, contrast, polarity, fit = np.empty((count, 2)), np.empty(count), np.empty(count, np.int8), np.empty(count)
    careful = np.ones(count, bool) if careful is None else np.ascontiguousarray(careful, bool)
    _axes(
        plain(grey), xy, radius, careful.view(np.uint8), MIN_CONTRAST, directions(), _gain(),
        axes, contrast, polarity, fit,
    )  # fmt: skip
    return Orientation(axes, contrast, polarity, fit)


def sample_rings(grey: Array, xy: Array, radius: Real[Array, "n r"]) -> Array:
    """Grey levels (N, R, 2 HALF_TURN) float32 on rings of `radius` (N, R) px, at directions 0, π / HALF_TURN, …"""
    out = np.empty((*radius.shape, 2 * HALF_TURN), np.float32)
    xy, radius = np.ascontiguousarray(xy, np.float64), np.ascontiguousarray(radius, np.float64)
    _sample(plain(grey), xy, radius, directions(), out)
    return out


@lru_cache(maxsize=1)
def directions() -> Array:
    """Cosines and sines (2, 2 HALF_TURN) of the directions at which rings are sampled."""
    angle = np.arange(2 * HALF_TURN) * (np.pi / HALF_TURN)
    return np.stack(cos_sin(angle)).astype(np.float32)


@lru_cache(maxsize=1)
def _gain() -> Array:
    """(2 HALF_TURN,), at HALF_TURN + k: the factor from the squared sum over a sector of k directions to the variance
    between both sectors."""
    wide = np.arange(1.0, HALF_TURN)
    out = np.zeros(2 * HALF_TURN, np.float32)
    out[HALF_TURN + 1 :] = 1 / (wide * (HALF_TURN - wide))
    return out
