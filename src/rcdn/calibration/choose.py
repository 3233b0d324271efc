"""How a lens model does on pictures that it was not calibrated from, and which model to take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3, State, default_free, residuals, solve
from rcdn.types import Array

FOLDS = 5
FEWEST = 4
"""pictures, below which nothing is held out"""
SIMPLER = 1.0
"""standard errors of the mean by which a model must beat a simpler one"""


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


def best(trials: list[Trial], weight: Array, picture: Array) -> int:
    """Which of `trials`, the simplest first, to take: the simplest that no other beats by more than chance on pictures held out.

    Compared by picture: the mean difference of their whitened squares against its standard error. Without pictures held out: the second, if
    there is one, as calibrations usually have it.
    """
    squares = [_by_picture(t.held, weight, picture) for t in trials]
    if any(np.isnan(s).all() for s in squares):
        return min(1, len(trials) - 1)
    winner = int(np.argmin([s.mean() for s in squares]))
    for k in range(winner):
        gain = squares[k] - squares[winner]
        if np.isfinite(gain).all() and gain.mean() <= SIMPLER * gain.std(ddof=1) / np.sqrt(len(gain)):
            return k
    return winner


def _by_picture(gaps: Array, weight: Array, picture: Array) -> Array:
    """Mean whitened square of each picture; infinite where the camera can't see a corner."""
    pictures = np.unique(picture[weight > 0])
    square = (gaps**2).sum(axis=1) * weight**2
    if np.isnan(gaps[weight > 0]).all():
        return np.full(len(pictures), np.nan)
    square = np.nan_to_num(square, nan=np.inf)
    return np.array([square[(picture == p) & (weight > 0)].mean() for p in pictures])
