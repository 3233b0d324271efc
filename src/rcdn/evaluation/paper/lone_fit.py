"""The blurred-pattern fit of `auto` (rcdn/precision) for a corner without a board: two blurred edges that cross.

A board tells its corners their directions, blur and light; here all comes from the corner's own pixels.
"""

from __future__ import annotations

import numpy as np

from rcdn.corners.adaptive import LONE_PITCH
from rcdn.corners.orientation import axes
from rcdn.precision.lattice import Lattice
from rcdn.precision.model import BLEED, BLUR, CONTRAST, COUNT, CURVE, LIGHT, MEAN, TURN, Windows, crossing, picture
from rcdn.precision.window import batches, windows
from rcdn.types import Array

RADIUS = 0.35 * LONE_PITCH
"""px of the rings that tell the edges' directions"""
WIDE = 6.0
"""px; a blur that cuts no pixel off"""
BLURS = (0.5, 0.8, 1.2, 2.0, 3.2, 5.0)
"""px that the fit may start from"""
BLUR_RANGE = (0.25, 20.0)
"""px"""
MIDDLE = 127.0
"""grey level around which the model is asked for its shape: it is cut at 0 and 255"""
STEPS = 10
LONGEST = np.array([0.1] * 6 + [0.4] * 2 + [0.3] + [np.inf] * 6)
"""longest step of each parameter"""
FAR = 2.0
"""px from the start beyond which a fit isn't believed"""


def lone_fit(grey: Array, xy: Array, failed: Array) -> tuple[Array, Array]:
    """Positions (N, 2) px of corners near `xy` (N, 2) of `grey` (H, W), and whether the fit failed, (N,): the start stands there.

    Squares are taken to be `LONE_PITCH` px along their edges. Starts that have `failed` (N,) aren't fitted.
    """
    out, lost = xy.copy(), np.ones(len(xy), bool)
    seen = axes(grey, xy, np.full(len(xy), RADIUS)).axes
    good = np.flatnonzero(~failed & np.isfinite(seen).all(axis=1))
    if not len(good):
        return out, lost
    step = LONE_PITCH * np.stack([np.cos(seen[good]), np.sin(seen[good])], axis=1)
    maps = _maps(xy[good], step)
    for batch in batches(grey, maps, xy[good], np.zeros((len(good), 2), bool), WIDE):
        state = _fit(windows(maps, batch))
        moved = np.einsum("nij,nj->ni", step[batch.which], crossing(state))
        fine = np.isfinite(moved).all(axis=1) & (np.linalg.norm(moved, axis=1) < FAR)
        which = good[batch.which[fine]]
        out[which] += moved[fine]
        lost[which] = False
    return out, lost


def _maps(xy: Array, step: Array) -> Lattice:
    """Affine maps of corners at `xy` (N, 2) px; `step` (N, 2, 2): px by squares."""
    terms = np.zeros((len(xy), 6, 2))
    terms[:, 1:3] = np.linalg.inv(step).swapaxes(1, 2)
    return Lattice(np.eye(3), xy, terms)


def _fit(w: Windows) -> Array:
    """States (n, COUNT) by Gauss–Newton with weak beliefs: axes nearly right, edges nearly straight, light nearly even."""
    state = _start(w)
    mean, sd = state.copy(), np.full_like(state, np.inf)
    sd[:, TURN], sd[:, CURVE], sd[:, BLUR], sd[:, BLEED] = 0.2, 0.02, 0.5, 0.3
    sd[:, LIGHT] = 0.1 * np.maximum(np.abs(state[:, CONTRAST]), 1.0)[:, None]
    for _ in range(STEPS):
        value, slopes = picture(w, state, others=False)
        residual = (w.value - value) * w.weight
        variance = (residual**2).sum(axis=1) / np.maximum(w.weight.sum(axis=1) - COUNT, 1)
        stiff = np.maximum(variance, 0.1)[:, None] / sd**2
        heavy = slopes * w.weight[:, None]
        normal = (heavy @ slopes.swapaxes(1, 2)).astype(np.float64)
        normal[:, np.arange(COUNT), np.arange(COUNT)] += stiff + 1e-6
        pull = (slopes @ residual[..., None])[..., 0].astype(np.float64) + stiff * (mean - state)
        state = state + np.clip(np.linalg.solve(normal, pull[..., None])[..., 0], -LONGEST, LONGEST)
        state[:, BLUR] = np.clip(state[:, BLUR], *np.log(BLUR_RANGE))
    return state


def _start(w: Windows) -> Array:
    """States (n, COUNT) of straight edges with the blur of `BLURS`, grey level and contrast that fit each corner best."""
    count = w.weight.sum(axis=1, keepdims=True)
    level = (w.weight * w.value).sum(axis=1, keepdims=True) / count
    best, state = np.full(len(w.value), np.inf), np.zeros((len(w.value), COUNT))
    for blur in BLURS:
        guess = np.zeros_like(state)
        guess[:, BLUR], guess[:, MEAN], guess[:, CONTRAST] = np.log(blur), MIDDLE, 1.0
        shape = picture(w, guess, others=False)[0] - np.float32(MIDDLE)
        middle = (w.weight * shape).sum(axis=1, keepdims=True) / count
        a, b = (shape - middle) * w.weight, (w.value - level) * w.weight
        contrast = (a * b).sum(axis=1) / np.maximum((a * a).sum(axis=1), 1e-9)
        left = ((b - contrast[:, None] * a) ** 2).sum(axis=1)
        guess[:, CONTRAST], guess[:, MEAN] = contrast, level[:, 0] - contrast * middle[:, 0]
        better = left < best
        state[better], best[better] = guess[better], left[better]
    return state
