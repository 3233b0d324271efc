"""The parametric fit of all corners of a board: each corner independently at first, then with the parameters that they
share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rcdn.geometry.elementary import exp, log
from rcdn.geometry.matrices import inverse, product
from rcdn.geometry.median import median, medians
from rcdn.native import bind
from rcdn.precision.lattice import Lattice, Maps, lattice, misfit
from rcdn.precision.model import BLUR, CONTRAST, COUNT, CURVE, MEAN, SHIFT, crossing
from rcdn.precision.prior import Prior, board_mean, board_prior, first_prior
from rcdn.precision.surroundings import PLAIN, Print, Surroundings
from rcdn.precision.window import frames
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

BLURS = np.array([0.5, 0.8, 1.2, 2.0, 3.2, 5.0])
"""initial guesses of the blur, px"""
WIDE = 6.0
"""px; with bands for this blur, windows include the pixels of any blurred edge"""
FEW, SOME = 60, 300
"""numbers of pixels per corner for the choice of the initial guess, and for the first round"""
TRUSTING = 2
"""Gauss–Newton steps before pixels are weighted by their residuals"""
ROUNDS = (2, 2, 1)
"""Gauss–Newton steps of the rounds that follow"""
ODD = 0.1
"""standard error, squares, of a corner all of whose pixels disagree with the model; if only a share does, beyond what
is usual on the board, × the square of that share (shadow edges and covers, as rendered)"""
CROOKED = 0.012
"""standard error of a corner, × the misfit of its neighbours to its map (measured on bent boards and barrel
distortion)"""
SHARE = 1 / 3
"""side of a block of pixels whose influences are summed, squares (from 1 to 8 px)"""
DOUBT = 0.15
"""standard deviation of the log of a board's measured factor"""
SPILL = 1.3
"""correlation extends beyond the border of a block: the true factor is the measured one to this power (low-passed
noise, JPEG)"""
LOUD = 2.0
"""a corner whose own factor is more than this many times the board's gets a larger variance than the others"""


class Settings(NamedTuple):
    """Settings of the kernel, see `fit_round`."""

    noise: float
    steps: int
    robust: bool
    board: bool
    tell: bool
    share: float


class Found(NamedTuple):
    """Outputs of the kernel, see `Round`."""

    variance: Array
    kept: Array
    own: Array
    unit: Array
    scores: Array


_fit = bind("rcdn_fit", Maps, Print, Settings, Found)
_levels = bind("rcdn_fit_levels", Maps, Print)


@dataclass(frozen=True, eq=False)
class Fit:
    """The fit of N corners.

    `xy` (N, 2) px and `cov` (N, 2, 2) px², from noise, its correlation between pixels, and misfit. `state` (N, COUNT);
    `variance` (N,) of the residuals; `kept` (N,) the share of the pixels that agree with the model.
    """

    xy: Array
    cov: Array
    state: Array
    variance: Array
    kept: Array


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the fit: `state` (N, COUNT); `variance` (N,) of the residuals; `kept` (N,), share of the pixels that
    agree; of the inverse normal matrix the diagonal `own` (N, COUNT) and the block `unit` (N, 2, 2) of the shift; and
    the sums `scores` (N, 2) for `spreads`."""

    state: Array
    variance: Array
    kept: Array
    own: Array
    unit: Array
    scores: Array


def fit_corners(
    grey: Shaped[Array, "h w"], ij: Int[Array, "n 2"], xy: Real[Array, "n 2"], around: Surroundings | None = None
) -> Fit:
    """Fit every corner of a board with labels `ij` (N, 2) near `xy` (N, 2) px of `grey` (H, W).

    The rounds after the first take windows and maps from the corners of the previous round, and a prior of blur, bleed
    and illumination from the whole board. `around`: what is printed besides squares.
    """
    if grey.dtype != np.uint8:
        grey = grey.astype(np.float32, copy=False)
    grey = np.ascontiguousarray(grey)
    prints, plane, ends = ((PLAIN,), None, None) if around is None else (around.drawn, around.plane, around.ends)
    every, maps, rim = np.arange(len(xy)), lattice(ij, xy, plane=plane), _rim(ij)
    blur, state, noise, drawn = _start(grey, maps, frames(maps, xy, rim, WIDE, FEW, ends), prints)
    prior, frame = first_prior(state), frames(maps, xy, rim, blur, SOME, ends)
    state[:, SHIFT] = maps(every, xy)  # the map is a least-squares fit that need not pass through its own corner
    trusting = fit_round(grey, frame, maps, state, prior, noise, TRUSTING, drawn=drawn, robust=False, tell=False)
    state, noise = trusting.state, min(median(trusting.variance), noise)
    for index, steps in enumerate(ROUNDS):
        first, last = index == 0, index + 1 == len(ROUNDS)
        share = SHARE if last else 0.0
        done = fit_round(grey, frame, maps, state, prior, noise, steps, drawn=drawn, tell=first or last, share=share)
        xy = maps.pixels(every, crossing(done.state), xy)
        if last:
            break
        state, noise, maps = done.state.copy(), median(done.variance), lattice(ij, xy, plane=plane)
        state[:, SHIFT], state[:, CURVE] = maps(every, xy), 0
        if first:
            prior = board_prior(ij, done.state, done.own * done.variance[:, None], prior, plane)
            frame = frames(maps, xy, rim, float(exp(median(state[:, BLUR]))), ends=ends)
        else:
            prior = Prior(board_mean(ij, done.state, plane), prior.sd)
    return Fit(xy, _covariance(maps, ij, xy, done, plane), done.state, done.variance, done.kept)


def levels(
    grey: Array, frame: Array, maps: Lattice, blurs: Real[Array, " k"], drawn: Print = PLAIN
) -> Real[Array, "k n 3"]:
    """Residual variance, grey level and contrast (K, N, 3) of straight edges with `blurs` (K,) px in each of N windows
    `frame`."""
    out = np.empty((len(blurs), len(frame), 3))
    _levels(grey, maps.maps, drawn, frame, blurs, out)
    return out


def fit_round(
    grey: Array,
    frame: Array,
    maps: Lattice,
    state: Array,
    prior: Prior,
    noise: float,
    steps: int,
    *,
    drawn: Print = PLAIN,
    robust: bool = True,
    board: bool = True,
    tell: bool = True,
    share: float = 0.0,
) -> Round:
    """`steps` Gauss–Newton steps of the corners' states (N, COUNT) towards the best fit of their windows `frame` under
    the prior.

    `noise`: variance of the board's residuals, the least variance that is assumed for a pixel. `robust`: pixels that
    disagree with the model lose their weight. `board`: the model includes the edges of the next corners. `tell`:
    compute `own` and `unit`, and, unless `share` is 0, `scores` from blocks whose side is `share` of a square's;
    otherwise they are 0.
    """
    state = state.copy()
    found = Found(*(np.zeros((len(frame), *tail)) for tail in ((), (), (COUNT,), (2, 2), (2,))))
    settings = Settings(noise, steps, robust, board, tell, share)
    _fit(grey, maps.maps, drawn, frame, state, prior.mean, 1 / prior.sd**2, settings, found)
    return Round(state, *found)


def _covariance(maps: Lattice, ij: Array, xy: Array, done: Round, plane: Array | None) -> Real[Array, "n 2 2"]:
    """Covariances (N, 2, 2) px², from correlated noise, pixels that disagree with the model, and the misfit of the
    maps."""
    cov = done.unit * spreads(done.scores, done.variance)[:, None, None]
    noise = median(np.trace(cov, axis1=1, axis2=2)) / 2
    typical = median(done.kept)
    odd = np.maximum(1 - done.kept / typical, 0) if typical > 0 else np.ones(len(xy))
    extra = (ODD * odd**2) ** 2 + np.square(CROOKED * misfit(maps, ij, xy, noise, plane))
    cov = cov + extra[:, None, None] * np.eye(2)
    jacobian = inverse(maps.with_jacobian(np.arange(len(xy)), xy)[1])
    return product(product(jacobian, cov), jacobian.swapaxes(1, 2))


def spreads(scores: Real[Array, "n 2"], variance: Real[Array, " n"]) -> Real[Array, " n"]:
    """Effective variance (N,) per pixel, grey levels², by which the inverse normal matrix is to be multiplied, where
    the errors of pixels are correlated or not identically distributed.

    JPEG, demosaicking and sharpening correlate the errors of neighbouring pixels, and a model that doesn't fit exactly
    leaves residuals that are not noise. The uncertainty follows from the variance of the influence of whole blocks of
    pixels on the position, where influence is leverage × residual. Misfit that is the same on both sides of the corner
    (a blur of another shape, ink, gamma) has opposite influences in opposite blocks, which cancel: so blocks are summed
    with their mirror images.

    `scores` (N, 2): sums over blocks of pixels of their squared influence on the position, and the expectation of that
    for white noise of variance 1 (which allows for the constraint that the influences of all blocks of a corner add up
    to 0). `variance` (N,) of the residuals. One factor for the board, shrunk towards 1 as far as chance explains it,
    and a larger one for corners whose own factor is well above the board's.
    """
    white = np.maximum(scores[:, 1] * variance, 1e-12)
    factor = max(float(scores[:, 0].sum() / white.sum()), 1e-3)
    power = float(log(factor))
    square = power * power
    power *= (SPILL if power > 0 else 1.0) * square / (square + DOUBT * DOUBT)
    factor = float(exp(power))
    return np.asarray(variance * factor * np.maximum(1, scores[:, 0] / white / factor / LOUD))


def _rim(ij: Array) -> Array:
    return np.asarray((ij == ij.min(axis=0)) | (ij == ij.max(axis=0)))


def _start(grey: Array, maps: Lattice, frame: Array, prints: tuple[Print, ...]) -> tuple[float, Array, float, Print]:
    """The blur of `BLURS` and the print with which straight edges fit the board best: blur, states (N, COUNT),
    variance, print."""
    found = np.stack([levels(grey, frame, maps, BLURS, drawn) for drawn in prints])
    typical = [medians(each[..., 0]) for each in found]
    kind = int(np.argmin([values.min() for values in typical]))
    best = int(np.argmin(typical[kind]))
    state = np.zeros((len(frame), COUNT))
    state[:, BLUR] = log(BLURS[best])
    state[:, [MEAN, CONTRAST]] = found[kind, best, :, 1:]
    return float(BLURS[best]), state, float(typical[kind][best]), prints[kind]
