"""The model of a corner's window: two blurred edges that cross, and the edges of the next corners.

In board coordinates (u, v), squares from the corner, a checkerboard is the product of two square waves. Its picture is
m + c·U(u)·V(v), with each wave blurred across its own edges. m and c may vary linearly over the window (illumination);
an edge may be rotated or curved; bright areas may spread into dark ones or dark into bright (ink, over-exposure, a
nonlinear response): bleed. Levels beyond the sensor's range are clipped. The kernel of the fit (src/native/fit_model.h)
has the formula.
"""

from __future__ import annotations

import numpy as np

from rcdn.native import constants
from rcdn.types import Array
from rcdn.types.arrays import Real

_C = constants("fit")
COUNT, MEAN, CONTRAST = _C["COUNT"], _C["MEAN"], _C["CONTRAST"]
SHIFT, TURN, CURVE = slice(0, 2), slice(2, 4), slice(4, _C["BLUR"])
BLUR, BLEED, LIGHT = slice(_C["BLUR"], _C["BLEED"]), slice(_C["BLEED"], MEAN), slice(CONTRAST + 1, COUNT)
"""The parameters: shift of both edges, squares; their slopes, squares per square; their curvatures, squares per
square²; log of their blurs, px; bleed, px; grey level and contrast; gradients of the level along u and v, and of the
contrast along u and v."""


def crossing(state: Array) -> Real[Array, "n 2"]:
    """The crossing point of the two edges, (N, 2) squares from the corner."""
    u, v = state[:, 0], state[:, 1]
    for _ in range(3):
        u, v = state[:, 0] + v * (state[:, 2] + v * state[:, 4]), state[:, 1] + u * (state[:, 3] + u * state[:, 5])
    return np.stack([u, v], axis=1)
