"""Uncertainty of fitted positions where the errors of pixels are correlated or not identically distributed.

JPEG, demosaicking and sharpening correlate the errors of neighbouring pixels, and a model that doesn't fit exactly
leaves residuals that are not noise. The uncertainty follows from the variance of the influence of whole blocks of
pixels on the position, where influence is leverage × residual. Misfit that is the same on both sides of the corner (a
blur of another shape, ink, gamma) has opposite influences in opposite blocks, which cancel: so blocks are summed with
their mirror images.
"""

from __future__ import annotations

import numpy as np

from rcdn.geometry.elementary import exp, log
from rcdn.types import Array
from rcdn.types.arrays import Real

SHARE = 1 / 3
"""side of a block, squares (from 1 to 8 px)"""
DOUBT = 0.15
"""standard deviation of the log of a board's measured factor"""
SPILL = 1.3
"""correlation extends beyond the border of a block: the true factor is the measured one to this power (low-passed
noise, JPEG)"""
LOUD = 2.0
"""a corner whose own factor is more than this many times the board's gets a larger variance than the others"""


def spreads(scores: Real[Array, "n 2"], variance: Real[Array, " n"]) -> Real[Array, " n"]:
    """Effective variance (N,) per pixel, grey levels², by which the inverse normal matrix is to be multiplied.

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
