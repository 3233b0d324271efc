"""The joint least squares over a rig: lenses, camera poses, board poses, and the shape of the most frequent board, if
it has one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import choose, robust
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.shape import FUNCTIONS
from rcdn.calibration.uncertainty import UNBIASED
from rcdn.types import Array

COMPARED = 60
"""largest number of moments, evenly chosen, on which a perfect board and one with a shape are compared"""


@dataclass(frozen=True, eq=False)
class Joint:
    """All `corners`, whose `basis` holds the functions of a board's shape, with `sigma` (N,) px; `cluster` (F,): moment
    of each frame; `known`: for each camera, whether its lens is held constant."""

    corners: Corners3
    sigma: Array
    cluster: Array
    known: Sequence[bool] = ()


def fitted(joint: Joint, start: State, shaped: bool, spacing: float) -> robust.Fit:
    """The solution from the initial guess `start`, whose board is perfect; or that with a board shape common to all
    cameras, if it is to be tried (`shaped`), unless a perfect board predicts the boards of held-out moments far better.
    `spacing`: side of a square, m."""
    state, noise = robust.initial_fit(start, joint.corners, joint.sigma, free_of(start, joint))
    if shaped:
        found = _fit(joint, replace(state, shape=np.zeros((len(FUNCTIONS), 3)), prior=None), noise, spacing)
        if not _flat_predicts_better(joint, found):
            return found
    return _fit(joint, state, noise, spacing)


def _fit(joint: Joint, state: State, noise: float, spacing: float) -> robust.Fit:
    free = free_of(state, joint)
    return robust.fit(state, noise, joint.corners, joint.sigma, free, joint.cluster, spacing, UNBIASED)


def refitted(joint: Joint, before: robust.Fit, spacing: float) -> robust.Fit:
    """The solution for changed corners of the same problem, started from the solution `before`, with the same
    unknowns."""
    return robust.fit(
        replace(before.state, prior=None),
        before.noise,
        joint.corners,
        joint.sigma,
        before.free,
        joint.cluster,
        spacing,
        UNBIASED,
    )


def free_of(state: State, joint: Joint) -> Array:
    """Which of the shared parameters are unknown: all but the known lenses."""
    free = default_free(state, shape=True, rig=True)
    held = np.repeat(np.asarray(joint.known, bool), state.counts[: len(joint.known)])
    free[: len(held)] &= ~held
    return free


def _flat_predicts_better(joint: Joint, fit: robust.Fit) -> bool:
    """`choose.flat_predicts_better` on some of the moments."""
    moment = joint.cluster[joint.corners.frame]
    every = np.unique(moment)
    some = np.isin(moment, every[np.linspace(0, len(every) - 1, min(len(every), COMPARED)).astype(int)])
    task = choose.Task(joint.corners.take(some), fit.weight[some], moment[some])
    if not choose.enough_pictures(task.picture):
        return False
    flat = replace(fit.state, shape=np.zeros((0, 3)), prior=None)
    held = choose.held_out_rms(fit.state, task, free_of(fit.state, joint))
    return choose.flat_predicts_better(flat, held, task, free_of(flat, joint))
