"""The parametric fit of all corners of a board: each by itself first, then with what the board has in common."""

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
from rcdn.precision.spread import SHARE, spreads
from rcdn.precision.surroundings import PLAIN, Print, Surroundings
from rcdn.precision.window import frames
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

BLURS = np.array([0.5, 0.8, 1.2, 2.0, 3.2, 5.0])
"""px that the fit may start from"""
WIDE = 6.0
"""px; a blur that no band cuts off"""
FEW, SOME = 60, 300
"""pixels a corner that are enough to choose the start, and for the first round"""
TRUSTING = 2
"""Gauss–Newton steps before residuals are judged"""
ROUNDS = (2, 2, 1)
"""steps of the rounds that follow"""
ODD = 0.1
"""squares by which a corner may be wrong whose pixels all disagree with the model, more than the board's usually do; where
part of them does, this share squared (shadow edges and covers, as rendered)"""
CROOKED = 0.012
"""error of a corner, × how far its neighbours lie off its map (measured on bent boards and barrels)"""


class Settings(NamedTuple):
    """How the kernel fits, see `fit_round`."""

    noise: float
    steps: int
    robust: bool
    board: bool
    tell: bool
    share: float


class Found(NamedTuple):
    """What the kernel finds, see `Round`."""

    variance: Array
    kept: Array
    own: Array
    unit: Array
    scores: Array


_fit = bind("rcdn_fit", Maps, Print, Settings, Found)
_levels = bind("rcdn_fit_levels", Maps, Print)


@dataclass(frozen=True, eq=False)
class Fit:
    """What the fit found at each of N corners.

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
    """State (N, COUNT); variance (N,); share of pixels (N,); of the inverse normal matrix the diagonal `own` (N, COUNT) and the shift's
    `unit` (N, 2, 2); and sums (N, 2) for `spreads`."""

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

    In the rounds after the first, windows and maps start from the corners of the one before, and blur, bleed and light of the
    whole board are known. `around`: what is printed besides squares.
    """
    if grey.dtype != np.uint8:
        grey = grey.astype(np.float32, copy=False)
    grey = np.ascontiguousarray(grey)
    prints, plane, ends = ((PLAIN,), None, None) if around is None else (around.drawn, around.plane, around.ends)
    every, maps, rim = np.arange(len(xy)), lattice(ij, xy, plane=plane), _rim(ij)
    blur, state, noise, drawn = _start(grey, maps, frames(maps, xy, rim, WIDE, FEW, ends), prints)
    prior, frame = first_prior(state), frames(maps, xy, rim, blur, SOME, ends)
    state[:, SHIFT] = maps(every, xy)  # the map is a fit, and doesn't go through its own corner
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
    """Residual variance, grey level and contrast (K, N, 3) of straight edges of `blurs` (K,) px in each of N windows `frame`."""
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
    """Lead the states (N, COUNT) of corners by `steps` of Gauss–Newton towards the best fit of their windows `frame`, within the prior.

    `noise`: variance of the board's residuals; no pixel is taken as more certain than that. `robust`: pixels that disagree lose their weight.
    `board`: the next corners have edges too. `tell`: `own` and `unit` are wanted, and `scores` from blocks whose sides are `share` of a square's,
    if not 0; they are 0 otherwise.
    """
    state = state.copy()
    found = Found(*(np.zeros((len(frame), *tail)) for tail in ((), (), (COUNT,), (2, 2), (2,))))
    settings = Settings(noise, steps, robust, board, tell, share)
    _fit(grey, maps.maps, drawn, frame, state, prior.mean, 1 / prior.sd**2, settings, found)
    return Round(state, *found)


def _covariance(maps: Lattice, ij: Array, xy: Array, done: Round, plane: Array | None) -> Real[Array, "n 2 2"]:
    """Covariances (N, 2, 2) px²: noise as it is, pixels that disagree, and maps that don't follow the board."""
    cov = done.unit * spreads(done.scores, done.variance)[:, None, None]
    noise = median(np.trace(cov, axis1=1, axis2=2)) / 2
    usual = median(done.kept)
    odd = np.maximum(1 - done.kept / usual, 0) if usual > 0 else np.ones(len(xy))
    extra = (ODD * odd**2) ** 2 + np.square(CROOKED * misfit(maps, ij, xy, noise, plane))
    cov = cov + extra[:, None, None] * np.eye(2)
    jacobian = inverse(maps.with_jacobian(np.arange(len(xy)), xy)[1])
    return product(product(jacobian, cov), jacobian.swapaxes(1, 2))


def _rim(ij: Array) -> Array:
    return np.asarray((ij == ij.min(axis=0)) | (ij == ij.max(axis=0)))


def _start(grey: Array, maps: Lattice, frame: Array, prints: tuple[Print, ...]) -> tuple[float, Array, float, Print]:
    """The blur of `BLURS` and the print under which straight edges fit the board best, and the states (N, COUNT) and variance that go with them."""
    found = np.stack([levels(grey, frame, maps, BLURS, drawn) for drawn in prints])
    typical = [medians(each[..., 0]) for each in found]
    kind = int(np.argmin([values.min() for values in typical]))
    best = int(np.argmin(typical[kind]))
    state = np.zeros((len(frame), COUNT))
    state[:, BLUR] = log(BLURS[best])
    state[:, [MEAN, CONTRAST]] = found[kind, best, :, 1:]
    return float(BLURS[best]), state, float(typical[kind][best]), prints[kind]
