"""The prior of a corner's parameters, from its neighbours and its board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry.median import median, medians
from rcdn.native import bind
from rcdn.precision.lattice import neighbours
from rcdn.precision.model import BLEED, BLUR, CONTRAST, COUNT, CURVE, LIGHT, MEAN, TURN
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

LOUD = 3.0
"""deviation from the prior's mean, in standard deviations, beyond which a corner's prior is widened to that
deviation"""
MAD = 1.4826
"""standard deviation of a normal distribution, × its median absolute deviation"""
DOUBT = 1.25
"""factor on the variance of noise that is subtracted from the measured variance, to allow for chance"""
PAIRS = np.array(
    [(s.start, s.stop - 1) for s in (TURN, CURVE, BLUR, BLEED)] + np.arange(COUNT)[LIGHT].reshape(2, 2).tolist()
)
"""pairs of parameters with a common spread"""
FEW = 8
"""least number of corners of a kind from which their spread is estimated"""


_slopes = bind("rcdn_lattice_slopes")


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal priors of the parameters: `mean`, `sd` (N, COUNT); sd is inf for a parameter without a prior."""

    mean: Array
    sd: Array


def first_prior(state: Array) -> Prior:
    """Weak prior for the first round: maps are nearly right, the blur is near the initial guess, illumination is
    smooth."""
    sd = np.full_like(state, np.inf)
    sd[:, TURN], sd[:, CURVE], sd[:, BLUR], sd[:, BLEED] = 0.05, 0.02, 0.5, 0.3
    sd[:, LIGHT] = 0.1 * max(median(np.abs(state[:, CONTRAST])), 1.0)
    return Prior(state.copy(), sd)


def board_prior(
    ij: Int[Array, "n 2"], state: Array, variance: Array, before: Prior, plane: Array | None = None
) -> Prior:
    """The prior of the corners at `ij` (N, 2), with means and spreads estimated from the board itself
    (empirical Bayes).

    `state`, `variance` (N, COUNT): the first round's parameters and their variances, given the prior `before`; `plane`:
    as of `lattice`. The means of blur and bleed are those of the board; those of the gradients of illumination follow
    from the neighbours' grey levels; edges follow the map. The spread is the variance of the estimates less that of
    noise; a corner with a much larger deviation gets a wide prior. So a board in even light regains the information
    that free gradients would cost, and one in a patchy shadow keeps them free.
    """
    near = neighbours(ij, 1)
    mean, sd = _mean(near, state, ij if plane is None else plane), np.full_like(state, np.inf)
    inner, stray, least = near.min(axis=1) >= 0, np.abs(state - mean), _least(state)[PAIRS]
    for mine in (np.flatnonzero(inner), np.flatnonzero(~inner)):
        at = mine[:, None, None], PAIRS
        believed = before.sd[at]
        if len(mine) >= FEW:
            believed = np.minimum(_spread(stray[at], variance[at], least[:, 0]), believed)
        sd[at] = believed
    return Prior(mean, sd)


def board_mean(ij: Int[Array, "n 2"], state: Array, plane: Array | None = None) -> Array:
    """The means (N, COUNT) of `board_prior` for the corners at `ij` (N, 2)."""
    return _mean(neighbours(ij, 1), state, ij if plane is None else plane)


def _mean(near: Array, state: Array, plane: Array) -> Array:
    mean = np.zeros_like(state)
    edges = slice(BLUR.start, BLEED.stop)
    mean[:, edges] = medians(state[:, edges].T)
    mean[:, LIGHT] = _light(near, state, plane)
    return mean


def _least(state: Array) -> Array:
    """Least spread of each parameter, (COUNT,); inf for those without a prior."""
    least = np.full(COUNT, np.inf)
    least[TURN], least[CURVE], least[BLUR], least[BLEED] = 0.003, 0.001, 0.02, 0.005
    least[LIGHT] = 0.002 * max(median(np.abs(state[:, CONTRAST])), 1.0)
    return least


def _spread(stray: Real[Array, "n k 2"], variance: Array, least: Real[Array, " k"]) -> Real[Array, "n k 2"]:
    """Standard deviation of the true values about the prior's mean, (N, K, 2): common to both parameters of a pair and
    to all corners except outliers. `stray` (N, K, 2): deviations from the mean; `variance` (N, K, 2): theirs by noise;
    `least` (K,): least spread.
    """
    typical, noise = (medians(np.swapaxes(a, 0, 1).reshape(len(least), -1)) for a in (stray, variance))
    common = np.maximum((MAD * typical) ** 2 - DOUBT * noise, least**2)[:, None]
    return np.where(stray > LOUD * np.sqrt(variance + common), stray, np.sqrt(common))


def _light(near: Int[Array, "n 9"], state: Array, plane: Real[Array, "n 2"]) -> Real[Array, "n 4"]:
    """Gradients (N, 4) of level and contrast along u and v, from planes fitted to the values of the neighbours `near`
    (N, 9) at `plane` (N, 2)."""
    slopes = np.empty((len(state), 4))
    _slopes(np.ascontiguousarray(plane, float), near, np.ascontiguousarray(state[:, [MEAN, CONTRAST]]), slopes)
    return slopes
