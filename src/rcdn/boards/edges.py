"""Pixel tests of the board recovery: whether an edge joins two corners, and whether two edges cross at a predicted
corner.

Images `grey` are contiguous (H, W), uint8 or float32; grey levels are interpolated bilinearly, and the border is
replicated.
"""

from __future__ import annotations

import numpy as np

from rcdn.geometry.elementary import exp
from rcdn.geometry.median import median
from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Real

_sample, _contrast, _steps = bind("rcdn_sample"), bind("rcdn_edge_contrast"), bind("rcdn_edge_steps")
_crossings = bind("rcdn_crossings")


def edge_contrast(
    grey: Array, start: Real[Array, "l 2"], end: Real[Array, "l 2"], close: bool = False
) -> Real[Array, "l 3"]:
    """Contrast between the two sides of each link, (L, 3) grey levels: the mean difference in each third of its length.

    `start`, `end` (L, 2) px. Positive: the side at rising angle (clockwise on the screen) from the direction
    start → end is brighter. Offsets to the side are a seventh of the length, from 1 to 5 px, or if `close` a thirtieth,
    from 1 to 2.5 px: a marker may leave only a narrow rim of a square. At both ends, where blur mixes all four squares,
    nothing is sampled.
    """
    out = np.empty((len(start), 3))
    _contrast(grey, _plane(start), _plane(end), int(close), out)
    return out


def edge_sharpness(grey: Array, start: Real[Array, "l 2"], end: Real[Array, "l 2"]) -> float:
    """Sharpness of the edges of links: the step within 0.2 of a link's length ÷ the step within 0.6; median of all
    links.

    `start`, `end` (L, 2) px. Near 1 for a printed edge in focus, 0.33 for a ramp, 0.38 for a sinusoidal profile.
    """
    if not len(start):
        return 0.0
    step = np.empty((len(start), 2))
    _steps(grey, _plane(start), _plane(end), step)
    near, far = step.T
    return median(near / np.where(np.abs(far) > 1e-6, far, np.inf))


def sample_grey(grey: Array, xy: Real[Array, "... 2"]) -> Array:
    """Bilinearly interpolated grey levels at `xy` (..., 2)."""
    out = np.empty(xy.shape[:-1])
    _sample(grey, _plane(xy).reshape(-1, 2), out.reshape(-1))
    return out


def _plane(xy: Array) -> Array:
    return np.ascontiguousarray(xy, np.float64)


ROWS = np.linspace(0.08, 0.36, constants("edges")["ROWS"], dtype=np.float32)
"""distances from a crossing at which its sides are sampled, squares"""
SPAN, STEPS = 0.34, constants("edges")["STEPS"]
"""half-length of the profiles across an edge, squares, and their number of samples"""
WIDTH = 0.05
"""width of the Gaussian that smooths the profiles' derivatives, squares"""
TAPS = constants("edges")["TAPS"]
"""samples to either side that enter a smoothed derivative: a share of 3e-8 lies beyond"""
DARK = 6.0
"""grey levels added before the logarithm, so that noise in dark regions does not count as contrast"""


def _slope_taps() -> Array:
    """(TAPS,) weights of the differences of the samples after and before one, for the smoothed derivative there, per
    square."""
    gap = np.arange(1, STEPS // 2 + 1) * (2 * SPAN / (STEPS - 1) / WIDTH)
    taps = gap * exp(-0.5 * gap * gap)
    return np.asarray(taps[:TAPS] / (2 * taps.sum()) * (2 / WIDTH), np.float32)


_AT, _TAPS = np.linspace(-SPAN, SPAN, STEPS, dtype=np.float32), _slope_taps()


def crossings(
    grey: Array, xy: Real[Array, "n 2"], du: Real[Array, "n 2"], dv: Real[Array, "n 2"], colour: Real[Array, " n"]
) -> tuple[Array, Array]:
    """Where a board's two edges cross near a predicted corner, and how strong they are.

    `xy` (N, 2) px: predicted corners; `du`, `dv` (N, 2) px: the board's steps there; `colour` (N,) ±1: whether the
    square towards (+u, +v) is bright or dark. Returns offsets (N, 2) along u and v, squares, and strengths (N, 2):
    derivatives of the logarithm of the grey level, per square, of the weaker of an edge's two halves. The edge of an
    X-corner changes its sign at the crossing; the edge of a shadow or of an occluder does not, so that one of its
    halves has no strength. The logarithm gives lit and shaded parts the same contrast. The median along an edge
    rejects the place where a shadow crosses it, and is zero where most of the edge is covered.
    """
    offset, strength = np.empty((len(xy), 2)), np.empty((len(xy), 2))
    steps = _plane(xy), _plane(du), _plane(dv), np.ascontiguousarray(colour, np.float64)
    _crossings(grey, *steps, ROWS, _AT, DARK, _TAPS, offset, strength)
    return offset, strength
