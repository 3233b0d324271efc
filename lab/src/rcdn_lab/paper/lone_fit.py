"""The blurred-pattern fit of `auto` (rcdn/precision) for a corner without a board: two blurred edges that cross.

In a board, neighbouring corners provide directions, blur and illumination; here all are estimated from the corner's own
pixels.
"""

from __future__ import annotations

import numpy as np

from rcdn.corners.adaptive import LONE_PITCH
from rcdn.corners.orientation import axes
from rcdn.precision.fit import fit_round, levels
from rcdn.precision.lattice import Lattice
from rcdn.precision.model import BLEED, BLUR, CONTRAST, COUNT, CURVE, LIGHT, MEAN, TURN, crossing
from rcdn.precision.prior import Prior
from rcdn.precision.window import frames
from rcdn.types import Array

RADIUS = 0.35 * LONE_PITCH
"""px of the rings from which the edges' directions are estimated"""
WIDE = 6.0
"""px; a blur large enough that no pixel is excluded"""
BLURS = np.array([0.5, 0.8, 1.2, 2.0, 3.2, 5.0])
"""px, initial guesses of the blur"""
STEPS = 10
FAR = 2.0
"""px from the initial position beyond which a fit is rejected"""


def lone_fit(grey: Array, xy: Array, failed: Array) -> tuple[Array, Array]:
    """Positions (N, 2) px of corners near `xy` (N, 2) of `grey` (H, W), and whether the fit failed, (N,), in which case
    the initial position is returned.

    Squares are assumed to be `LONE_PITCH` px along their edges. Initial positions that have `failed` (N,) are not
    fitted.
    """
    out, lost = xy.copy(), np.ones(len(xy), bool)
    seen = axes(grey, xy, np.full(len(xy), RADIUS)).axes
    good = np.flatnonzero(~failed & np.isfinite(seen).all(axis=1))
    if not len(good):
        return out, lost
    step = LONE_PITCH * np.stack([np.cos(seen[good]), np.sin(seen[good])], axis=1)
    maps = _maps(xy[good], step)
    state = _fit(grey, maps, frames(maps, xy[good], np.zeros((len(good), 2), bool), WIDE))
    moved = np.einsum("nij,nj->ni", step, crossing(state))
    fine = np.isfinite(moved).all(axis=1) & (np.linalg.norm(moved, axis=1) < FAR)
    out[good[fine]] += moved[fine]
    lost[good[fine]] = False
    return out, lost


def _maps(xy: Array, step: Array) -> Lattice:
    """Affine maps of corners at `xy` (N, 2) px; `step` (N, 2, 2): px per square."""
    terms = np.zeros((len(xy), 6, 2))
    terms[:, 1:3] = np.linalg.inv(step).swapaxes(1, 2)
    return Lattice(np.eye(3), xy, terms)


def _fit(grey: Array, maps: Lattice, frame: Array) -> Array:
    """States (n, COUNT) by Gauss–Newton with weak priors: axes nearly right, edges nearly straight, illumination nearly
    even."""
    state = _start(grey, maps, frame)
    sd = np.full_like(state, np.inf)
    sd[:, TURN], sd[:, CURVE], sd[:, BLUR], sd[:, BLEED] = 0.2, 0.02, 0.5, 0.3
    sd[:, LIGHT] = 0.1 * np.maximum(np.abs(state[:, CONTRAST]), 1.0)[:, None]
    return fit_round(grey, frame, maps, state, Prior(state, sd), np.inf, STEPS, robust=False, board=False).state


def _start(grey: Array, maps: Lattice, frame: Array) -> Array:
    """Initial states (n, COUNT) with straight edges and the blur of `BLURS`, grey level and contrast that fit each
    corner best."""
    found = levels(grey, frame, maps, BLURS)
    best = np.argmin(found[..., 0], axis=0)
    state = np.zeros((len(frame), COUNT))
    state[:, BLUR] = np.log(BLURS[best])[:, None]
    state[:, [MEAN, CONTRAST]] = found[best, np.arange(len(frame)), 1:]
    return state
