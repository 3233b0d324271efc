"""Tells a grid of circles from a checkerboard: the gaps between discs make a square lattice of saddles, too.

The squares of a board are looked at through their own corners. On a checkerboard the dark ones and the bright ones are
alike but for their colour, and their edges run straight from corner to corner; among discs the dark "squares" are
round, and the bright ones are what these leave. Both are models under a blur; the one that leaves less of the variance
of the board's usual square unexplained is what is printed. Cameras cut off white and black and bend the curve of grey
between them, which rounds the corners of squares: both models may do so.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.targets.glance import SAMPLES, Glance
from rcdn.types import Array

RADII = np.arange(0.2, 0.72, 0.025)
"""of discs, squares: at 0.71 they touch, and under 0.28 their gaps are seldom taken for corners"""
BLURS = np.geomspace(0.03, 0.45, 12)
"""standard deviations, squares"""
LEVELS = np.arange(0.55, 0.96, 0.05)
"""grey levels, share of the contrast, above which all is white; or, from the other end, below which all is black"""
GAMMAS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2)
"""exponents of the camera's curve"""
SHIFTS = (-0.1, -0.05, 0.0, 0.05, 0.1)
"""how far the edges of dark squares are moved outwards, squares"""
FAINT = 0.01
"""contrast of a model of which blur and overexposure leave nothing to see"""
FINE = 4
"""places of the models' raster in one of SAMPLES"""
SHARE, ROUND, STRAIGHT = 0.3, 0.04, 0.004
"""variance that the discs leave unexplained: at most this share of what the checkerboard leaves, at most ROUND of all;
and the checkerboard must leave STRAIGHT of all at least, since under a wide blur both are one"""


def is_circle_grid(glance: Glance) -> bool:
    """Are the squares of a board discs, and what is between them? False where nothing tells."""
    usual = _usual_square(glance)
    discs, squares = _models()
    straight = _unexplained(squares, usual)
    if straight < STRAIGHT:
        return False
    half = len(usual) // 2
    inverse = -np.concatenate([usual[half:], usual[:half]])  # bright discs
    round_ = min(_unexplained(discs, usual), _unexplained(discs, inverse))
    return round_ <= min(SHARE * straight, ROUND)


def _usual_square(glance: Glance) -> Array:
    """The dark and the bright squares around a corner, folded by their symmetries (2 · N,): the median over all
    corners, each with the same mean and contrast, so that shade, noise and what covers some don't count."""
    around = _folded(glance.squares)
    one, other = (around[:, 0, 0] + around[:, 1, 1]) / 2, (around[:, 0, 1] + around[:, 1, 0]) / 2
    swap = glance.odd[:, None]
    weights = _weights()
    both = np.concatenate([np.where(swap, other, one), np.where(swap, one, other)], axis=1)
    both = both - (both @ weights)[:, None]
    both /= np.maximum(np.sqrt(both**2 @ weights), 1e-6)[:, None]
    usual = np.median(both, axis=0)
    half = len(weights) // 2
    dark_first = usual[:half] @ weights[:half] < 0
    return np.asarray(usual if dark_first else np.roll(usual, half))


def _folded(squares: Array) -> Array:
    """Squares (..., S, S) by what their eight symmetries leave, (..., N)."""
    even = squares + squares[..., ::-1, :]
    even = even + even[..., ::-1]
    even = (even + even.swapaxes(-1, -2)) / 8
    i, j = np.triu_indices(SAMPLES // 2)
    return np.asarray(even[..., i, j])


@lru_cache
def _weights() -> Array:
    """(2 · N,) share of each folded place in a dark and a bright square."""
    i, j = np.triu_indices(SAMPLES // 2)
    weights = np.tile(np.where(i == j, 1.0, 2.0), 2)
    return np.asarray(weights / weights.sum())


def _unexplained(models: Array, seen: Array) -> float:
    """Share of the variance of `seen` (2 · N,) that the best of `models` (K, 2 · N), none with mean, all with a
    variance of 1, leaves."""
    weights = _weights()
    seen = seen - seen @ weights
    variance = float(seen**2 @ weights)
    gain = float(np.max(models @ (weights * seen)))
    return 1 - max(gain, 0.0) ** 2 / variance if variance > 0 else 1.0


@lru_cache
def _models() -> tuple[Array, Array]:
    """What discs, and squares, may look like: (K, 2 · N) each, without their mean, with a variance of 1."""
    across = (np.arange(2 * SAMPLES * FINE) + 0.5) / (SAMPLES * FINE)
    x, y = np.meshgrid(across, across)
    return _seen([_discs(x, y, radius) for radius in RADII]), _seen([_squares(x, y, shift) for shift in SHIFTS])


def _seen(drawn: list[Array]) -> Array:
    """Drawings of two by two squares that repeat themselves, under all blurs and curves of exposure, as models."""
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
    """White 1 but for discs of 0 in the middles of every other square; one step of the raster wide at the edge."""
    nearest = np.minimum(*(np.hypot(_off(x, k), _off(y, k)) for k in (0, 1)))
    return np.asarray(np.clip((nearest - radius) * SAMPLES * FINE + 0.5, 0, 1))


def _squares(x: Array, y: Array, shift: float) -> Array:
    """White 1 but for squares of 0 whose edges are moved outwards by `shift`."""
    inside = [(_off(x, k) < 0.5 + shift) & (_off(y, k) < 0.5 + shift) for k in (0, 1)]
    return 1.0 - (inside[0] | inside[1])


def _off(x: Array, k: int) -> Array:
    """Distance from the nearest middle of the squares of which every other one is `k`."""
    return np.abs((x - 0.5 - k + 1) % 2 - 1)
