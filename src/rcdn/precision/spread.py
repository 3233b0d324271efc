"""How certain fitted positions are where pixels' errors are neither white nor alike.

JPEG, demosaicking and sharpening make errors of neighbouring pixels go together, and a model that doesn't quite fit
leaves residuals that are no noise at all. What counts is how much the pull of whole blocks of pixels on the position
varies. Misfit that is the same on both sides of the corner (a blur of another shape, ink, gamma) pulls opposite blocks
opposite ways and moves nothing: so blocks are summed with their mirror images.
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
"""errors that go together don't stop at a block's rim: the true factor is the measured one to this power (low-passed noise, JPEG)"""
LOUD = 2.0
"""a corner whose own factor is this many times the board's is less certain than the board's others"""


def spreads(scores: Real[Array, "n 2"], variance: Real[Array, " n"]) -> Real[Array, " n"]:
    """Variance (N,) of the pull of a pixel, grey levels², that makes the normal matrix honest.

    `scores` (N, 2): sums over blocks of pixels, of squared pulls on the position, and of what white noise of variance 1 would give
    (the fit makes the pulls of all blocks of a corner add up to nothing, which it allows for). `variance` (N,) of the
    residuals. One factor for the board, believed as far as it stands out from chance, and more for corners whose own
    stands out from the board's.
    """
    white = np.maximum(scores[:, 1] * variance, 1e-12)
    factor = max(float(scores[:, 0].sum() / white.sum()), 1e-3)
    power = float(log(factor))
    square = power * power
    power *= (SPILL if power > 0 else 1.0) * square / (square + DOUBT * DOUBT)
    factor = float(exp(power))
    return np.asarray(variance * factor * np.maximum(1, scores[:, 0] / white / factor / LOUD))
