"""Where board recovery looks at pixels: is there an edge between two corners, and do two edges cross where a corner should be?

Pictures `grey` are contiguous (H, W), uint8 or float32; grey levels are bilinear, and the border repeats outside.
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


def edge_contrast(grey: Array, start: Real[Array, "l 2"], end: Real[Array, "l 2"]) -> Real[Array, "l 3"]:
    """What separates the two sides of each link, (L, 3) grey levels: one mean difference for each third of its length.

    `start`, `end` (L, 2) px. Positive: the side at rising angle (clockwise on the screen) from the direction start → end is brighter.
    Offsets to the side stay between 1 and 5 px; where blur mixes all four squares, at both ends, nothing is looked at.
    """
    out = np.empty((len(start), 3))
    _contrast(grey, _plane(start), _plane(end), out)
    return out


def edge_sharpness(grey: Array, start: Real[Array, "l 2"], end: Real[Array, "l 2"]) -> float:
    """How sudden the edges of links are: the step within 0.2 of a link's length, share of that within 0.6; their median.

    `start`, `end` (L, 2) px. Near 1 for a printed edge in focus, 0.33 for a ramp, 0.38 where grey levels wave like a sine.
    """
    if not len(start):
        return 0.0
    step = np.empty((len(start), 2))
    _steps(grey, _plane(start), _plane(end), step)
    near, far = step.T
    return median(near / np.where(np.abs(far) > 1e-6, far, np.inf))


def sample_grey(grey: Array, xy: Real[Array, "... 2"]) -> Array:
    """Bilinear grey levels at `xy` (..., 2)."""
    out = np.empty(xy.shape[:-1])
    _sample(grey, _plane(xy).reshape(-1, 2), out.reshape(-1))
    return out


def _plane(xy: Array) -> Array:
    return np.ascontiguousarray(xy, np.float64)


ROWS = np.linspace(0.08, 0.36, constants("edges")["ROWS"], dtype=np.float32)
"""where the sides of a crossing are sampled, squares from it"""
SPAN, STEPS = 0.34, constants("edges")["STEPS"]
"""reach and samples of the profiles across an edge, squares to either side and in all"""
WIDTH = 0.05
"""smoothing of the profiles' slopes, squares"""
TAPS = constants("edges")["TAPS"]
"""samples to either side that a smoothed slope looks at: three hundred-millionths are beyond"""
DARK = 6.0
"""grey levels added before the logarithm, so that noise in the dark doesn't count as contrast"""


def _slope_taps() -> Array:
    """(TAPS,) weights of the samples after one, less those before it, for the smoothed slope there, a square."""
    gap = np.arange(1, STEPS // 2 + 1) * (2 * SPAN / (STEPS - 1) / WIDTH)
    taps = gap * exp(-0.5 * gap * gap)
    return np.asarray(taps[:TAPS] / (2 * taps.sum()) * (2 / WIDTH), np.float32)


_AT, _TAPS = np.linspace(-SPAN, SPAN, STEPS, dtype=np.float32), _slope_taps()


def crossings(
    grey: Array, xy: Real[Array, "n 2"], du: Real[Array, "n 2"], dv: Real[Array, "n 2"], colour: Real[Array, " n"]
) -> tuple[Array, Array]:
    """Where a board's two edges cross near a spot that the board predicts, and how plainly they are seen.

    `xy` (N, 2) px the spots; `du`, `dv` (N, 2) px the board's steps there; `colour` (N,) ±1: the square towards (+u, +v) is bright or
    dark. Returns offsets (N, 2) along u and v, squares, and strengths (N, 2): slopes of the logarithm of the grey level, a square, the
    weaker of an edge's two halves. An X-corner's edge changes its sign in the crossing: the edge of a shadow or of a cover doesn't, and
    is seen in neither half's company. The logarithm makes lit and shaded parts alike; the median along an edge leaves out where a shadow
    crosses it, and sees nothing where most of it is covered.
    """
    offset, strength = np.empty((len(xy), 2)), np.empty((len(xy), 2))
    steps = _plane(xy), _plane(du), _plane(dv), np.ascontiguousarray(colour, np.float64)
    _crossings(grey, *steps, ROWS, _AT, DARK, _TAPS, offset, strength)
    return offset, strength
