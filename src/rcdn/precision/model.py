"""What the surroundings of a corner look like: two blurred edges that cross, and those of the next corners.

In board coordinates (u, v), squares from the corner, a checkerboard is the product of two square waves. Its picture is
m + c·U(u)·V(v), with each wave blurred across its own edges. m and c may rise linearly over the window (light); an edge
may be turned or bent; bright may have run into dark (ink, over-exposure, a response that isn't linear). Levels beyond the
sensor's range are cut. The kernel of the fit (src/native/fit_model.h) has the formula.
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
"""The parameters: shift of both edges, squares; their turns, squares a square; their curvatures, squares a square²; log of
their blurs, px; bleed, px; grey level and contrast; slopes of the level along u and v, of the contrast along u and v."""


def crossing(state: Array) -> Real[Array, "n 2"]:
    """Where the two edges cross, (N, 2) squares from the corner."""
    u, v = state[:, 0], state[:, 1]
    for _ in range(3):
        u, v = state[:, 0] + v * (state[:, 2] + v * state[:, 4]), state[:, 1] + u * (state[:, 3] + u * state[:, 5])
    return np.stack([u, v], axis=1)
