"""What a corner's neighbours and its board say of a corner's parameters before its own pixels do."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from rcdn.precision.lattice import neighbours
from rcdn.precision.model import BLEED, BLUR, CONTRAST, COUNT, CURVE, LIGHT, MEAN, TURN
from rcdn.types import Array

LOUD = 3.0
"""standard deviations from the prior beyond which a corner's own pixels are believed"""
DOUBT = 1.25
"""the spread that noise explains, with what chance adds to it, × its variance"""
PAIRS = ((2, 3), (4, 5), (6, 7), (8,), (11, 12), (13, 14))
"""parameters that stray alike"""
FEW = 8
"""corners of a kind whose spread is not measured"""


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal distributions of the parameters: `mean`, `sd` (N, COUNT); sd is inf where nothing is known."""

    mean: Array
    sd: Array


def first_prior(state: Array) -> Prior:
    """Weak beliefs for the first round: maps are nearly right, the blur is about that of the start, light is smooth."""
    sd = np.full_like(state, np.inf)
    sd[:, TURN], sd[:, CURVE], sd[:, BLUR], sd[:, BLEED] = 0.05, 0.02, 0.5, 0.3
    sd[:, LIGHT] = 0.1 * max(float(np.median(np.abs(state[:, CONTRAST]))), 1.0)
    return Prior(state.copy(), sd)


def board_prior(ij: Array, state: Array, variance: Array, before: Prior) -> Prior:
    """What the corners at `ij` (N, 2) have in common, and how far they really stray from it (empirical Bayes).

    `state`, `variance` (N, COUNT): the first round's parameters and their variances, given `before`. Blur and bleed are
    those of the board; slopes of the light follow from the neighbours' grey levels; edges turn and bend as the map says.
    The spread is what the estimates vary by, less what noise explains, and a corner that strays much further is let
    go. So a board in even light gains all the information that free slopes would cost, and one in a patchy shadow
    keeps its freedom.
    """
    near, there = neighbours(ij, 1)
    mean, sd = np.zeros_like(state), np.full_like(state, np.inf)
    mean[:, 6:9] = np.median(state[:, 6:9], axis=0)
    mean[:, LIGHT] = _light(ij[near] - ij[:, None], there, state[near])
    inner = there.all(axis=1)
    least = _least(state)
    for pair, mine in itertools.product(PAIRS, (inner, ~inner)):
        at = np.ix_(np.flatnonzero(mine), np.array(pair))
        sd[at] = before.sd[at]
        if mine.sum() >= FEW:
            sd[at] = np.minimum(_spread(state[at] - mean[at], variance[at], float(least[pair[0]])), sd[at])
    return Prior(mean, sd)


def _least(state: Array) -> Array:
    """Smallest believable spread of each parameter, (COUNT,); inf for those without a prior."""
    least = np.full(COUNT, np.inf)
    least[TURN], least[CURVE], least[BLUR], least[BLEED] = 0.003, 0.001, 0.02, 0.005
    least[LIGHT] = 0.002 * max(float(np.median(np.abs(state[:, CONTRAST]))), 1.0)
    return least


def _spread(stray: Array, variance: Array, least: float) -> Array:
    """Standard deviation of the true values about the prior's mean, (N, K): common to all but those that stray."""
    common = max((1.4826 * float(np.median(np.abs(stray)))) ** 2 - DOUBT * float(np.median(variance)), least**2)
    loud = np.abs(stray) > LOUD * np.sqrt(variance + common)
    return np.where(loud, np.abs(stray), np.sqrt(common))


def _light(step: Array, there: Array, state: Array) -> Array:
    """Slopes (N, 4) of level and contrast along u and v, from planes through the neighbours' (N, K, ...) values."""
    sign = 1 - 2.0 * (step.sum(axis=-1) % 2)  # of the contrast, which alternates from corner to corner
    levels = np.stack([state[..., MEAN], sign * state[..., CONTRAST]], axis=-1)
    basis = np.concatenate([np.ones((*there.shape, 1)), step], axis=-1)
    weight = there.astype(float)
    normal = np.einsum("nk,nki,nkj->nij", weight, basis, basis) + 1e-6 * np.eye(3)
    planes = np.linalg.solve(normal, np.einsum("nk,nki,nkc->nic", weight, basis, levels))
    return np.concatenate([planes[:, 1:, 0], planes[:, 1:, 1]], axis=1)
