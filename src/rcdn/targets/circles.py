"""Distinguishes grids of circles and meshes from a checkerboard: the gaps between discs form a square lattice of
saddles, too, and so do the bars between the holes of a chain-link fence or a grating.

The squares of a board are sampled relative to their own corners. On a checkerboard dark and bright squares are alike
except for their colour, and their edges are straight from corner to corner; in a grid of circles the dark "squares" are
round, in a mesh the dark or bright ones stand on their corners, and the others are the remainder. All are modelled with
a blur; the model that leaves less of the variance of the board's median square unexplained is accepted. Cameras clip
white and black and have a nonlinear response between them, which rounds the corners of squares: all models include
that.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from rcdn.targets.quick_test import SAMPLES, CornerSamples
from rcdn.types import Array

RADII = np.arange(0.2, 0.72, 0.025)
"""candidate radii of discs, squares: at 0.71 they touch, and under 0.28 their gaps are seldom detected as corners"""
HOLES = np.arange(0.3, 0.96, 0.05)
"""candidate half-diagonals of a mesh's holes, squares: at 1 nothing is left of the bars between them"""
BLURS = np.geomspace(0.03, 0.45, 12)
"""candidate standard deviations of the blur, squares"""
LEVELS = np.arange(0.55, 0.96, 0.05)
"""candidate clipping levels, share of the contrast: levels above become white; or, counted from the other end, those
below become black"""
GAMMAS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2)
"""candidate exponents of the camera's response curve"""
SHIFTS = (-0.1, -0.05, 0.0, 0.05, 0.1)
"""candidate outward shifts of the edges of dark squares, squares"""
FAINT = 0.01
"""contrast of a model at or below which it is dropped: blur and overexposure leave nothing visible"""
FINE = 4
"""subdivision of one of SAMPLES in the models' raster"""
SHARE, ROUND, STRAIGHT = 0.3, 0.04, 0.004
"""thresholds of the variance left unexplained: by discs or holes, at most SHARE of what the checkerboard leaves and at
most ROUND of the total; by the checkerboard, at least STRAIGHT of the total, since under a wide blur all models are the
same"""
SHARPENED = (0.7, 0.3, 0.05)
"""the same for discs, if squares leave more: a camera that sharpens draws a rim around each disc, which no model has"""

Other = Literal["circles", "mesh"]
OTHERS: tuple[Other, ...] = ("circles", "mesh")


def other_pattern(samples: CornerSamples) -> Other | None:
    """What a board is if its squares are discs or the holes of a mesh, and the remainder; None if it is a checkerboard,
    or if that can't be decided."""
    square = _median_square(samples)
    straight = _unexplained(_models("squares"), square)
    if straight < STRAIGHT:
        return None
    half = len(square) // 2
    inverse = -np.concatenate([square[half:], square[:half]])  # bright discs or holes
    circles, mesh = (
        min(_unexplained(_models(other), square), _unexplained(_models(other), inverse)) for other in OTHERS
    )
    if min(circles, mesh) <= min(SHARE * straight, ROUND):
        return "circles" if circles <= mesh else "mesh"
    share, most, least = SHARPENED
    rimmed = straight >= least and circles <= min(share * straight, most, mesh)
    return "circles" if rimmed else None


def _median_square(samples: CornerSamples) -> Array:
    """The dark and the bright squares around a corner, averaged over their symmetries (2 · N,): the median over all
    corners, each normalised to the same mean and contrast, which makes it robust to shading, noise and occlusion of
    some."""
    around = _folded(samples.squares)
    one, other = (around[:, 0, 0] + around[:, 1, 1]) / 2, (around[:, 0, 1] + around[:, 1, 0]) / 2
    swap = samples.odd[:, None]
    weights = _weights()
    both = np.concatenate([np.where(swap, other, one), np.where(swap, one, other)], axis=1)
    both = both - (both @ weights)[:, None]
    both /= np.maximum(np.sqrt(both**2 @ weights), 1e-6)[:, None]
    median = np.median(both, axis=0)
    half = len(weights) // 2
    dark_first = median[:half] @ weights[:half] < 0
    return np.asarray(median if dark_first else np.roll(median, half))


def _folded(squares: Array) -> Array:
    """Squares (..., S, S) averaged over their eight symmetries, (..., N) distinct values."""
    even = squares + squares[..., ::-1, :]
    even = even + even[..., ::-1]
    even = (even + even.swapaxes(-1, -2)) / 8
    i, j = np.triu_indices(SAMPLES // 2)
    return np.asarray(even[..., i, j])


@lru_cache
def _weights() -> Array:
    """(2 · N,) weights of the distinct values of `_folded` in a dark and a bright square together."""
    i, j = np.triu_indices(SAMPLES // 2)
    weights = np.tile(np.where(i == j, 1.0, 2.0), 2)
    return np.asarray(weights / weights.sum())


def _unexplained(models: Array, seen: Array) -> float:
    """Share of the variance of `seen` (2 · N,) that the best of `models` (K, 2 · N), which have mean 0 and variance 1,
    leaves unexplained."""
    weights = _weights()
    seen = seen - seen @ weights
    variance = float(seen**2 @ weights)
    gain = float(np.max(models @ (weights * seen)))
    return 1 - max(gain, 0.0) ** 2 / variance if variance > 0 else 1.0


@lru_cache
def _models(pattern: Literal["squares", "circles", "mesh"]) -> Array:
    """Models of a pattern in two by two squares, (K, 2 · N), with mean 0 and variance 1."""
    across = (np.arange(2 * SAMPLES * FINE) + 0.5) / (SAMPLES * FINE)
    x, y = np.meshgrid(across, across)
    if pattern == "squares":
        return _seen([_squares(x, y, shift) for shift in SHIFTS])
    if pattern == "circles":
        return _seen([_discs(x, y, radius) for radius in RADII])
    return _seen([_holes(x, y, half) for half in HOLES])


@np.errstate(under="ignore")  # wide blurs leave nothing of fine detail
def _seen(drawn: list[Array]) -> Array:
    """Models from drawings of two by two squares, repeated periodically, with all blurs and response curves."""
    frequency = np.fft.fftfreq(2 * SAMPLES * FINE, 1 / (SAMPLES * FINE))
    gain = np.exp(-2 * (np.pi * BLURS[:, None] * frequency) ** 2)
    spectra = np.fft.fft2(np.array(drawn))[:, None] * gain[:, :, None] * gain[:, None, :]
    blurred = np.fft.ifft2(spectra).real.reshape(-1, 2, SAMPLES, FINE, 2, SAMPLES, FINE).mean(axis=(3, 6)).clip(0, 1)
    curves = [blurred**gamma for gamma in GAMMAS]
    curves += [np.minimum(blurred, level) for level in LEVELS] + [np.maximum(blurred, 1 - level) for level in LEVELS]
    cells = np.concatenate(curves)
    models, weights = _folded(cells[:, 0].transpose(0, 2, 1, 3)).reshape(len(cells), -1), _weights()
    models = models - (models @ weights)[:, None]
    contrast = np.sqrt(models**2 @ weights)
    seen = contrast > FAINT
    return np.asarray(models[seen] / contrast[seen, None])


def _discs(x: Array, y: Array, radius: float) -> Array:
    """White, 1, with discs of 0 at the centres of every other square; their edges are one step of the raster wide."""
    nearest = np.minimum(*(np.hypot(_off(x, k), _off(y, k)) for k in (0, 1)))
    return np.asarray(np.clip((nearest - radius) * SAMPLES * FINE + 0.5, 0, 1))


def _holes(x: Array, y: Array, half: float) -> Array:
    """White, 1, with squares of 0 that stand on their corners at the centres of every other square; `half`: half of
    their diagonals."""
    nearest = np.minimum(*(_off(x, k) + _off(y, k) for k in (0, 1)))
    return np.asarray(np.clip((nearest - half) * SAMPLES * FINE / np.sqrt(2) + 0.5, 0, 1))


def _squares(x: Array, y: Array, shift: float) -> Array:
    """White, 1, with squares of 0 whose edges are shifted outwards by `shift`."""
    inside = [(_off(x, k) < 0.5 + shift) & (_off(y, k) < 0.5 + shift) for k in (0, 1)]
    return 1.0 - (inside[0] | inside[1])


def _off(x: Array, k: int) -> Array:
    """Distance along one axis from the nearest centre of every other square, beginning with square `k`."""
    return np.abs((x - 0.5 - k + 1) % 2 - 1)
