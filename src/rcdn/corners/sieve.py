"""Where X-corners can be at all: what a network needn't look at."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind, constants
from rcdn.types import Array
from rcdn.types.arrays import Bool, Shaped

CELL = constants("network")["CELL"]
"""px"""
SHARE = 0.115
"""least √−det of the Hessian at half resolution, share of the local contrast"""
FLOOR = 6.0
"""grey levels added to the contrast, as in the networks' normalisation: noise in flat areas is no saddle"""

STEEP = 0.45
"""the same where squares are small: those of 5 to 10 px are steep all over, under noise of a tenth of their contrast and blurs to 1.5 px"""
STEEP_FLOOR, STEEP_FLOOR_BESIDE = 1.0, 3.0
"""grey levels: of squares from a contrast of 15 levels on, and of textures and drawings in 2 to 8 % of the cells; beside boards that are known,
from 30 levels on, and in 1 to 3 % (rendered boards, photographs)"""

_sieve = bind("rcdn_sieve")


def cells_with_saddles(grey: Shaped[Array, "h w"], share: float = SHARE) -> Array:
    """Which cells of 4×4 px an X-corner's response may peak in, (⌈H/4⌉, ⌈W/4⌉) bool, of a picture `grey` (H, W), uint8 or float32.

    An X-corner is a saddle of the grey levels. The picture is halved and smoothed (both 2 px wide or so), and a local peak of −det of the Hessian
    passes if its root is at least `share` of the local standard deviation (over 24 px) + `FLOOR`: the cells of pixels within 4.5 px of it
    along each axis are marked.
    """
    return _marked(grey, share) > 0


def saddles_and_steep_ones(grey: Array, floor: float) -> tuple[Array, Array]:
    """`cells_with_saddles`, and those among them whose saddles reach `STEEP` of the local standard deviation + `floor`, as in small squares."""
    kinds = _marked(grey, SHARE, floor)
    return kinds > 0, kinds > 1


def _marked(grey: Array, share: float, steep_floor: float = STEEP_FLOOR) -> Array:
    out = np.zeros([-(-n // CELL) for n in grey.shape], np.uint8)
    _sieve(np.ascontiguousarray(grey), share, FLOOR, STEEP, steep_floor, out)
    return out


def every_cell(grey: Array) -> Bool[Array, "h w"]:
    """All cells of a picture or map (H, W), (⌈H/4⌉, ⌈W/4⌉) bool."""
    return np.ones([-(-n // CELL) for n in grey.shape], bool)
