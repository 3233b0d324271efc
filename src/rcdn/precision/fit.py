"""The parametric fit of all corners of a board: each by itself first, then with what the board has in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.corners.erf import erf
from rcdn.precision.lattice import Lattice, lattice, misfit
from rcdn.precision.model import BLUR, CONTRAST, COUNT, CURVE, MEAN, SHIFT, Windows, crossing, crowded, picture
from rcdn.precision.prior import Prior, board_prior, first_prior
from rcdn.precision.spread import block_scores, spreads
from rcdn.precision.window import Batch, batches, windows
from rcdn.types import Array

BLURS = (0.5, 0.8, 1.2, 2.0, 3.2, 5.0)
"""px that the fit may start from"""
WIDE = 6.0
"""px; a blur that no band cuts off"""
FEW, SOME = 60, 300
"""pixels a corner that are enough to choose the start, and for the first round"""
ROUNDS = (4, 2, 1)
"""Gauss–Newton steps of the rounds"""
STEP = np.array([0.1] * 6 + [0.4] * 2 + [0.3] + [np.inf] * 6)
"""longest step of each parameter"""
BLUR_RANGE = (0.25, 20.0)
"""px"""
OUTLIER = (6.0, 0.15)
"""residuals beyond the larger of (noise, × contrast) have no weight"""
SOLID = 2
"""steps of the first round before residuals are judged"""
ODD = 0.1
"""squares by which a corner may be wrong whose pixels all disagree with the model, more than the board's usually do; where
part of them does, this share squared (shadow edges and covers, as rendered)"""
CROOKED = 0.012
"""error of a corner, × how far its neighbours lie off its map (measured on bent boards and barrels)"""
ROUNDING = 0.08
"""least variance of grey levels: they are whole numbers"""
FREEDOM = 8
"""parameters that the pixels of one corner really settle"""


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
class _Round:
    """State (N, COUNT), inverse normal matrix (N, COUNT, COUNT), variance (N,), share of pixels (N,), and score sums (N, 2)."""

    state: Array
    unit: Array
    variance: Array
    kept: Array
    scores: Array


def fit_corners(grey: Array, ij: Array, xy: Array) -> Fit:
    """Fit every corner of a board with labels `ij` (N, 2) near `xy` (N, 2) px of `grey` (H, W).

    In the rounds after the first, windows and maps start from the corners of the one before, and blur, bleed and light of the
    whole board are known.
    """
    every, maps, rim = np.arange(len(xy)), lattice(ij, xy), _rim(ij)
    blur, state, noise = _start(grey, maps, xy, rim)
    prior = first_prior(state)
    for index, repeats in enumerate(ROUNDS):
        state[:, SHIFT] = maps(every, xy)  # the map is a fit, and doesn't go through its own corner
        if index < 2:
            pixels = batches(grey, maps, xy, rim, blur, np.inf if index else SOME)
        done = _fit_round(maps, pixels, state, prior, noise, repeats, index)
        xy = maps.pixels(every, crossing(done.state), xy)
        if index + 1 < len(ROUNDS):
            own = np.diagonal(done.unit, axis1=1, axis2=2) * done.variance[:, None]
            known = board_prior(ij, done.state, own, prior)
            prior = known if index == 0 else Prior(known.mean, prior.sd)
            state, noise = done.state.copy(), float(np.median(done.variance))
            state[:, CURVE] = 0
            blur = float(np.exp(np.median(state[:, BLUR])))
            maps = lattice(ij, xy)
    return Fit(xy, _covariance(maps, ij, xy, done), done.state, done.variance, done.kept)


def _covariance(maps: Lattice, ij: Array, xy: Array, done: _Round) -> Array:
    """Covariances (N, 2, 2) px²: noise as it is, pixels that disagree, and maps that don't follow the board."""
    cov = done.unit[:, :2, :2] * spreads(done.scores, done.variance)[:, None, None]
    noise = float(np.median(np.trace(cov, axis1=1, axis2=2))) / 2
    odd = np.maximum(1 - done.kept / np.median(done.kept), 0)
    extra = (ODD * odd**2) ** 2 + (CROOKED * misfit(maps, ij, xy, noise)) ** 2
    cov = cov + extra[:, None, None] * np.eye(2)
    jacobian = np.linalg.inv(maps.with_slopes(np.arange(len(xy)), xy)[1])
    return np.asarray(jacobian @ cov @ jacobian.swapaxes(1, 2))


def _rim(ij: Array) -> Array:
    return np.asarray((ij == ij.min(axis=0)) | (ij == ij.max(axis=0)))


def _start(grey: Array, maps: Lattice, xy: Array, rim: Array) -> tuple[float, Array, float]:
    """The blur of `BLURS` under which straight edges fit the board best, and the states (N, COUNT) and variance that go with it."""
    levels = np.zeros((len(BLURS), len(xy), 3))
    for batch in batches(grey, maps, xy, rim, WIDE, FEW):
        w = windows(maps, batch)
        for k, blur in enumerate(BLURS):
            levels[k, batch.which] = _levels(w, blur)
    typical = np.median(levels[..., 0], axis=1)
    best = int(np.argmin(typical))
    state = np.zeros((len(xy), COUNT))
    state[:, BLUR] = np.log(BLURS[best])
    state[:, MEAN], state[:, CONTRAST] = levels[best, :, 1], levels[best, :, 2]
    return BLURS[best], state, float(typical[best])


def _levels(w: Windows, blur: float) -> Array:
    """Residual variance, grey level and contrast of each corner, (N, 3), by a line through pixels and model."""
    width = np.float32(np.sqrt(2) * blur)
    shape = erf(w.u / (width * w.gu)) * erf(w.v / (width * w.gv))
    count = np.maximum(w.weight.sum(axis=1, keepdims=True), 1)
    middle, level = ((w.weight * a).sum(axis=1, keepdims=True) / count for a in (shape, w.value))
    a, b = (shape - middle) * w.weight, (w.value - level) * w.weight
    contrast = (a * b).sum(axis=1, keepdims=True) / np.maximum((a * a).sum(axis=1, keepdims=True), 1e-9)
    left = ((b - contrast * a) ** 2).sum(axis=1, keepdims=True) / count
    return np.concatenate([left, level - contrast * middle, contrast], axis=1)


def _fit_round(
    maps: Lattice, pixels: list[Batch], state: Array, prior: Prior, noise: float, repeats: int, index: int
) -> _Round:
    """All corners of the board once more. `noise`: variance of its residuals; in the first round (`index` 0) a guess from above."""
    out = _Round(state.copy(), *(np.zeros((len(state), *tail)) for tail in ((COUNT, COUNT), (), (), (2,))))
    for batch in pixels:
        w, which = windows(maps, batch), batch.which
        own = Prior(prior.mean[which], prior.sd[which])
        found = _gauss_newton(w, state[which], own, noise, repeats, index)
        for whole, part in zip((out.state, out.unit, out.variance, out.kept, out.scores), found, strict=True):
            whole[which] = part
    return out


def _gauss_newton(w: Windows, state: Array, prior: Prior, noise: float, repeats: int, index: int) -> tuple[Array, ...]:
    """The columns of a `_Round`."""
    others = crowded(w, state)
    scores, (slopes, heavy) = np.zeros((len(state), 2)), np.empty((2, len(state), COUNT, w.u.shape[1]), np.float32)
    for step in range(repeats + 1):
        value, _ = picture(w, state, others, slopes)
        residual = w.value - value
        variance = _variance(residual, w.weight)
        level = max(noise if index else min(float(np.median(variance)), noise), ROUNDING)
        weight = w.weight
        if index or step >= SOLID:
            limit = np.maximum(OUTLIER[0] * np.sqrt(level), OUTLIER[1] * np.abs(state[:, CONTRAST]))
            weight = weight * _agreement(residual, limit)
        stiff = np.clip(variance, ROUNDING, 4 * level)[:, None] / prior.sd**2
        np.multiply(slopes, weight[:, None], out=heavy)
        normal = (heavy @ slopes.swapaxes(1, 2)).astype(np.float64)
        normal[:, np.arange(COUNT), np.arange(COUNT)] += stiff + 1e-6
        if step < repeats:
            pull = (heavy @ residual[..., None])[..., 0].astype(np.float64) + stiff * (prior.mean - state)
            state = state + np.clip(np.linalg.solve(normal, pull[..., None])[..., 0], -STEP, STEP)
            state[:, BLUR] = np.clip(state[:, BLUR], *np.log(BLUR_RANGE))
    unit = np.linalg.inv(normal)
    kept = weight.sum(axis=1) / np.maximum(w.weight.sum(axis=1), 1)
    left = np.maximum(_variance(residual, weight), ROUNDING)
    if index + 1 == len(ROUNDS):
        scores = block_scores(w, unit, residual, weight, slopes)
    return state, unit, left, kept, scores


def _agreement(residual: Array, limit: Array) -> Array:
    """Weights (N, P) that fall to 0 where residuals reach `limit` (N,): Tukey's."""
    share = residual * (1 / limit[:, None]).astype(np.float32)
    share *= share
    np.subtract(1, share, out=share)
    np.maximum(share, 0, out=share)
    share *= share
    return share


def _variance(residual: Array, weight: Array) -> Array:
    square = np.einsum("np,np,np->n", residual, residual, weight)
    return np.asarray(square / np.maximum(weight.sum(axis=1) - FREEDOM, 1), np.float64)
