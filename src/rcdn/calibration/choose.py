"""How a lens model does on pictures that it was not calibrated from, and which model to take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3, State, default_free, residuals, solve
from rcdn.calibration.sight import reach
from rcdn.types import Array

FOLDS = 5
FEWEST = 4
"""pictures, below which nothing is held out"""
LOST = 0.01
"""share of the frame without rays that is too much"""
SIMPLER = 1.05
"""× the least held-out error: a simpler model that stays below is taken"""


@dataclass(frozen=True, eq=False)
class Trial:
    """A model's `state` fitted to all corners, its `gaps` (N, 2) px there, and those of pictures `held` (N, 2) out of its calibration (NaN: none)."""

    state: State
    gaps: Array
    held: Array


def trial(start: State, corners: Corners3, weight: Array, free: Array, picture: Array) -> Trial:
    """Fit to the corners of positive `weight` (N,), then k-fold by `picture` (N,) integers: calibrate from the others, solve the poses of
    those held out, and take their residuals (the paper's pose error, section 4.4)."""
    state = solve(start, corners, weight, free).state
    held = np.full((len(corners), 2), np.nan)
    pictures = np.unique(picture[weight > 0])
    if len(pictures) >= FEWEST:
        for k in range(FOLDS):
            out = np.isin(picture, pictures[k::FOLDS])
            part = solve(state, corners, np.where(out, 0.0, weight), free, repeats=3).state
            mine = np.flatnonzero(out & (weight > 0))
            posed = solve(part, corners.take(mine), weight[mine], default_free(part, lens=False), repeats=2).state
            held[mine] = residuals(posed, corners.take(mine))
    return Trial(state, residuals(state, corners), held)


def rms(gaps: Array, weight: Array) -> float:
    """Root mean squared length of `gaps` (N, 2) of corners with a weight, px; NaN if there are none, infinite if one can't be seen."""
    mine = gaps[weight > 0]
    if not len(mine) or np.isnan(mine).all():
        return float("nan")
    return float(np.sqrt(np.nan_to_num((mine**2).sum(axis=1), nan=np.inf).mean()))


def best(trials: list[Trial], weight: Array) -> int:
    """Which of `trials`, the simplest first, to take: the simplest that does nearly as well as the best on pictures held out.

    A lens that has no rays for a part of the frame where another has them is passed over: polynomials may turn back where no corner was. Without
    pictures held out: `brown`, if it is there, as calibrations usually have it.
    """
    held = np.array([rms(t.held, weight) for t in trials])
    if np.isnan(held).any():
        models = [t.state.cameras[0].model for t in trials]
        return models.index("brown") if "brown" in models else 0
    reaches = np.array([reach(t.state.cameras[0]) for t in trials])
    held[reaches < reaches.max() - LOST] = np.inf
    return int(np.flatnonzero(held <= SIMPLER * held.min())[0])
