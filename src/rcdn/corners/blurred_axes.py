"""Edge directions by a least-squares model of a blurred corner on rings around it."""

from __future__ import annotations

import numpy as np

from rcdn.corners.orientation import HALF_TURN, RINGS, directions
from rcdn.errors import RcdnError
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real

_kernel = bind("rcdn_blurred_axes")


def blurred_axes(rings: Array, radius: Real[Array, "n 3"], start: Real[Array, "n 2"]) -> Real[Array, "n 2"]:
    """Axes (N, 2), radians, from `rings` (N, 3, 48): means of opposite directions at angles 0, π / 48, …

    `radius` (N, 3) px; `start` (N, 2) radians, a < b < a + π. Damped Gauss–Newton on m + c erf(d₁/s) erf(d₂/s), d the
    distances to the two edges: two blurred straight edges that cross. Blur makes the narrow sectors of a tilted corner
    appear wider than they are, which only a model of the blur corrects. m and c are eliminated (variable projection); a
    weak prior on the blur s decides where noise hides it. Where the residual grows or the fit diverges, `start` is
    kept.
    """
    rings = np.ascontiguousarray(rings, np.float32)
    if rings.shape[1:] != (RINGS, HALF_TURN):
        raise RcdnError(f"rings must be (N, {RINGS}, {HALF_TURN}), not {rings.shape}")
    axes = np.array(start, np.float64)
    _kernel(rings, np.ascontiguousarray(radius, np.float64), directions(), axes)
    return axes
