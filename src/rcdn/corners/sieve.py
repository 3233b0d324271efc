"""Cells that may contain X-corners: a network need not be evaluated elsewhere."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Bool, Shaped

CELL = constants("network")["CELL"]
"""side of a cell, px"""
SHARE = 0.115
"""least √(−det) of the Hessian at half resolution, share of the local contrast"""
FLOOR = 6.0
"""grey levels added to the contrast, as in the networks' normalisation, so that noise in flat areas gives no saddles"""

STEEP = 0.45
"""the same for steep saddles: the saddles of squares of 5 to 10 px are all steep, with noise of up to a tenth of their
contrast and blur of up to 1.5 px"""
BLUNT = 0.33
"""the same for blunt saddles: those of such squares under a blur of up to 3 px, and many others"""
STEEP_FLOOR, STEEP_FLOOR_BESIDE = 1.0, 3.0
"""grey levels added to the contrast for steep saddles. The first finds squares with a contrast of 15 levels or more,
and marks 2 to 8 % of the cells of textures and drawings; the second, for use beside known boards, finds those of 30
levels or more, and marks 1 to 3 % (rendered boards, photographs)"""

_sieve = bind("rcdn_sieve")


def cells_with_saddles(grey: Shaped[Array, "h w"], share: float = SHARE) -> Array:
    """The cells of 4×4 px in which an X-corner's response may peak, (⌈H/4⌉, ⌈W/4⌉) bool, of a picture `grey` (H, W),
    uint8 or float32.

    An X-corner is a saddle of the grey levels. The picture is halved and smoothed (both about 2 px wide). A local peak
    of −det of the Hessian passes if its square root is at least `share` · (local standard deviation over 24 px +
    `FLOOR`): the cells of all pixels within 4.5 px of it along each axis are marked.
    """
    return _marked(grey, share) > 0


def saddles_by_steepness(grey: Array, floor: float) -> tuple[Array, Array, Array]:
    """`cells_with_saddles`, and those among them with a blunt and with a steep saddle, as in small squares: at least
    `BLUNT` and `STEEP` · (local standard deviation + `floor`)."""
    kinds = _marked(grey, SHARE, floor)
    return kinds > 0, (kinds & 2) > 0, (kinds & 4) > 0


def _marked(grey: Array, share: float, steep_floor: float = STEEP_FLOOR) -> Array:
    out = np.zeros([-(-n // CELL) for n in grey.shape], np.uint8)
    _sieve(np.ascontiguousarray(grey), share, FLOOR, BLUNT, STEEP, steep_floor, out)
    return out


def every_cell(grey: Array) -> Bool[Array, "h w"]:
    """All cells of a picture or map (H, W), (⌈H/4⌉, ⌈W/4⌉) bool."""
    return np.ones([-(-n // CELL) for n in grey.shape], bool)
