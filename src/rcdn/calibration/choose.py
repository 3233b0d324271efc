"""Cross-validation of lens models on held-out pictures, and model selection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.sight import reach
from rcdn.calibration.solver import ROUGH_TOLERANCE, solve
from rcdn.types import Array, ModelScore
from rcdn.types.arrays import Real

FOLDS = 5
FEWEST = 4
"""least number of pictures for cross-validation"""
LOST = 0.01
"""share of the frame without rays above which a model is excluded"""
SIMPLER = 1.05
"""× the least held-out error: the simplest model below it is selected"""
FAR_BETTER = 1.25
"""× the held-out error of a model that lacks rays: it is not excluded if every other model's is larger. In simulated
sets these were as near to the truth up to 1.06, and 2.7 to 74 times as far from it where corners were from 1.35 on"""
ENOUGH = 6
"""least number of pictures for which the held-out error is used to decide whether the board's shape is real"""
FLAT = 1.1
"""× the held-out error with a perfect board: if that with the board's shape is larger than this, the shape is rejected.
A smaller excess does not count, since cross-validation estimates the shape from a fifth fewer views than there are"""


@dataclass(frozen=True, eq=False)
class Task:
    """The data on which all models are compared: `corners` with `weight` (N,), 0 for those left out, and the `picture`
    (N,) number of each."""

    corners: Corners3
    weight: Array
    picture: Array


def compare(starts: dict[str, State], task: Task, free: list[Array]) -> tuple[int, list[ModelScore]]:
    """Index of the selected model, and the score of each; `starts` are the models' initial states by name, the simplest
    first, `free` (K,) their unknowns.

    Selected is the simplest model whose held-out error, weighted as in the fit (`rms`), is close to the least. A model
    whose error on its own pictures is no smaller than the held-out error of a simpler one is not cross-validated. A
    lens that has no rays in a part of the frame in which another has them is excluded: polynomials may fold where no
    corner was. It is not if it predicts far better than those that have them (`FAR_BETTER`): these are of another kind
    of lens. With too few pictures `brown`, the usual choice, is selected if it is among the models.
    """
    states = [solve(s, task.corners, task.weight, f).state for s, f in zip(starts.values(), free, strict=True)]
    fits = [rms(residuals(s, task.corners), task.weight) for s in states]
    reaches = np.array([reach(s.cameras[0]) for s in states])
    whole = reaches >= reaches.max() - LOST
    held = np.full(len(states), np.nan)
    for k in np.flatnonzero(whole):
        if not (held <= SIMPLER * fits[k]).any():
            held[k] = held_out_rms(states[k], task, free[k])
    if not np.isnan(held).all():
        least = np.nanmin(held)
        for k in np.flatnonzero(~whole & (FAR_BETTER * np.array(fits) < least)):
            error = held_out_rms(states[k], task, free[k])
            held[k] = error if FAR_BETTER * error < least else np.nan
    scores = [ModelScore(*each) for each in zip(starts, fits, held.tolist(), strict=True)]
    if np.isnan(held).all():
        models = [s.cameras[0].model for s in states]
        return (models.index("brown") if "brown" in models else 0), scores
    return int(np.flatnonzero(held <= SIMPLER * np.nanmin(held))[0]), scores


def held_out(state: State, task: Task, free: Array) -> Real[Array, "n 2"]:
    """(N, 2) residuals px of k-fold cross-validation by picture: calibrate from the other pictures, solve the poses of
    the held-out ones, and take their residuals (the paper's pose error, section 4.4). NaN with fewer than FEWEST
    pictures, and for corners left out."""
    held = np.full((len(task.corners), 2), np.nan)
    pictures = np.unique(task.picture[task.weight > 0])
    if len(pictures) < FEWEST:
        return held
    for k in range(FOLDS):
        out = np.isin(task.picture, pictures[k::FOLDS])
        part = solve(state, task.corners, np.where(out, 0.0, task.weight), free, tolerance=ROUGH_TOLERANCE).state
        mine = np.flatnonzero(out & (task.weight > 0))
        some, firm = task.corners.take(mine), task.weight[mine]
        nothing = default_free(part, lens=False)
        held[mine] = residuals(solve(part, some, firm, nothing, iterations=20, tolerance=ROUGH_TOLERANCE).state, some)
    return held


def held_out_rms(state: State, task: Task, free: Array) -> float:
    """Error in held-out pictures, px: the `rms` of `held_out`."""
    return rms(held_out(state, task, free), task.weight)


def enough_pictures(picture: Array) -> bool:
    """Whether there are enough pictures, by the `picture` number (N,) of each corner, to decide by the held-out error
    whether the board's shape is real."""
    return len(np.unique(picture)) >= ENOUGH


def flat_predicts_better(flat: State, held: float, task: Task, free: Array) -> bool:
    """Whether a planar, evenly spaced board predicts held-out pictures far better than the estimated shape (`FLAT`),
    whose error there is `held`, px; False with fewer pictures than ENOUGH. `flat`: a state with such a board, `free`
    (K,) its unknowns.

    Views that hardly differ (none tilted, for example) do not determine a shape: it would then fit what is particular
    to these views. The held-out error is no smaller than that on the pictures of the fit: a flat board whose error
    there is too large is not cross-validated.
    """
    if not enough_pictures(task.picture):
        return False
    flat = solve(flat, task.corners, task.weight, free).state
    return (
        rms(residuals(flat, task.corners), task.weight) * FLAT < held and held_out_rms(flat, task, free) * FLAT < held
    )


def rms(gaps: Real[Array, "n 2"], weight: Array) -> float:
    """Root mean squared length of `gaps` (N, 2), px, each weighted by the square of its `weight` (N,): uncertain
    corners, as of blurred pictures, count little, as they do in the fit. NaN if no corner has a weight, infinite if one
    of those has no projection."""
    mine = weight > 0
    if not mine.any() or np.isnan(gaps[mine]).all():
        return float("nan")
    squares = np.nan_to_num((gaps[mine] ** 2).sum(axis=1), nan=np.inf)
    return float(np.sqrt(np.average(squares, weights=weight[mine] ** 2)))
