"""What the surroundings of a corner look like: two blurred edges that cross, and those of the next corners.

In board coordinates (u, v), squares from the corner, a checkerboard is the product of two square waves. Its picture is
m + c·U(u)·V(v), with each wave blurred across its own edges. m and c may rise linearly over the window (light); an edge
may be turned or bent; bright may have run into dark (ink, over-exposure, a response that isn't linear).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.corners.erf import erf
from rcdn.types import Array

SHIFT, TURN, CURVE, BLUR, BLEED = slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 8), slice(8, 9)
MEAN, CONTRAST, LIGHT = 9, 10, slice(11, 15)
COUNT = 15
"""The parameters: shift of both edges, squares; their turns, squares a square; their curvatures, squares a square²; log of
their blurs, px; bleed, px; grey level and contrast; slopes of the level along u and v, of the contrast along u and v."""
ROOT2 = np.float32(np.sqrt(2))
PEAK = np.float32(2 / np.sqrt(np.pi))
FLAT = np.float32(40)
"""exponent beyond which a slope falls no further: numbers under 1e-38 are slow to reckon with"""
FELT = 4.0
"""blurs at which an edge is no longer felt: erf is 1 to 1e-4"""
WHITE = 255


@dataclass(frozen=True, eq=False)
class Windows:
    """The pixels that tell of each of N corners, P a corner, float32.

    `value` (N, P) grey levels; `u`, `v` (N, P) squares from the corner; `gu`, `gv` (N, P) their slopes, squares a px;
    `weight` (N, P): 0 where there is no pixel; `spot` (2, N, P): where, px from the corner.
    """

    value: Array
    u: Array
    v: Array
    gu: Array
    gv: Array
    weight: Array
    spot: Array


def crowded(w: Windows, state: Array) -> bool:
    """Do the edges of the next corners reach into any window?"""
    blur = FELT * np.exp(state[:, BLUR]).astype(np.float32)
    near_u, near_v = 1 - np.abs(w.u) < blur[:, :1] * w.gu, 1 - np.abs(w.v) < blur[:, 1:] * w.gv
    return bool(((near_u | near_v) & (w.weight > 0)).any())


def _wave(own: Array, there: Array, push: Array, scale: Array, others: bool) -> tuple[Array, Array, Array]:
    """A blurred square wave with an edge at `own` + `push` = 0, and its slopes by `own` and by log blur. `scale`: 1 / (√2 blur).

    With `others`, it has the edges of the neighbours too, at `there` ± 1, which `push` moves the other way.
    """
    z = (own + push) * scale
    bell = _bell(z)
    value, by_own, by_blur = erf(z), bell * scale, -bell * z
    for side in (1, -1) if others else ():
        z = (there - np.float32(side) - push) * scale
        value -= erf(z)
        by_blur += _bell(z) * z
    return value, by_own, by_blur


def _bell(z: Array) -> Array:
    """Slope of erf at `z`."""
    out = z * z
    np.minimum(out, FLAT, out=out)
    np.negative(out, out=out)
    np.exp(out, out=out)
    out *= PEAK
    return np.asarray(out)


def picture(w: Windows, state: Array, others: bool, room: Array | None = None) -> tuple[Array, Array]:
    """Grey levels (N, P) of the model at `state` (N, COUNT), and their slopes (N, COUNT, P), float32.

    `others`: with the edges of the next corners; `room` (N, COUNT, P): where the slopes are written. Levels beyond the
    sensor's range are cut, and have no slope.
    """
    p = state.astype(np.float32)[:, :, None]
    uu, vv = w.u * w.u, w.v * w.v
    scale_u, scale_v = np.exp(-p[:, 6]) / (ROOT2 * w.gu), np.exp(-p[:, 7]) / (ROOT2 * w.gv)
    own_u = w.u - p[:, 0] - p[:, 2] * w.v - p[:, 4] * vv
    own_v = w.v - p[:, 1] - p[:, 3] * w.u - p[:, 5] * uu
    bleed = p[:, 8] * np.sign(p[:, CONTRAST])  # on either side of the crossing, an edge moves towards its dark side
    side_u, side_v = erf(own_v * scale_v) * w.gu, erf(own_u * scale_u) * w.gv
    one, one_, one_s = _wave(own_u, w.u, bleed * side_u, scale_u, others)
    two, two_, two_s = _wave(own_v, w.v, bleed * side_v, scale_v, others)
    slopes = np.empty((len(p), COUNT, w.u.shape[1]), np.float32) if room is None else room
    shape = np.multiply(one, two, out=slopes[:, 10])
    amplitude = p[:, CONTRAST] + p[:, 13] * w.u + p[:, 14] * w.v
    value = p[:, MEAN] + p[:, 11] * w.u + p[:, 12] * w.v + amplitude * shape
    one_ *= two
    two_ *= one
    slopes[:, 8] = np.abs(p[:, CONTRAST]) * (one_ * side_u + two_ * side_v)
    np.multiply(-amplitude, one_, out=slopes[:, 0])
    np.multiply(-amplitude, two_, out=slopes[:, 1])
    for k, (row, factor) in enumerate(((0, w.v), (1, w.u), (0, vv), (1, uu)), start=2):
        np.multiply(slopes[:, row], factor, out=slopes[:, k])
    slopes[:, 6], slopes[:, 7] = amplitude * one_s * two, amplitude * one * two_s
    slopes[:, 9], slopes[:, 11], slopes[:, 12] = 1, w.u, w.v
    np.multiply(w.u, shape, out=slopes[:, 13])
    np.multiply(w.v, shape, out=slopes[:, 14])
    if value.min() <= 0 or value.max() >= WHITE:
        slopes *= ((value > 0) & (value < WHITE))[:, None]
        np.clip(value, 0, WHITE, out=value)
    return value, slopes


def crossing(state: Array) -> Array:
    """Where the two edges cross, (N, 2) squares from the corner."""
    u, v = state[:, 0], state[:, 1]
    for _ in range(3):
        u, v = state[:, 0] + v * (state[:, 2] + v * state[:, 4]), state[:, 1] + u * (state[:, 3] + u * state[:, 5])
    return np.stack([u, v], axis=1)
