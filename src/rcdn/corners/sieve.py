"""Where X-corners can be at all: what a network needn't look at."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind, constants
from rcdn.types import Array

CELL = constants("network")["CELL"]
"""px"""
SHARE = 0.115
"""least √−det of the Hessian at half resolution, share of the local contrast"""
SMALL_SHARE = 0.45
"""the same where squares are small: those of 5 to 10 px have no place that reaches no half of it more, noise of 30 levels and a blur of 1 px or not;
textures and drawings have it in 1 % of their cells (found on rendered boards and on photographs)"""
FLOOR = 6.0
"""grey levels added to the contrast, as in the networks' normalisation: noise in flat areas is no saddle"""

_sieve = bind("rcdn_sieve")


def cells_with_saddles(grey: Array, share: float = SHARE) -> Array:
    """Which cells of 4×4 px an X-corner's response may peak in, (⌈H/4⌉, ⌈W/4⌉) bool, of a picture `grey` (H, W), uint8 or float32.

    An X-corner is a saddle of the grey levels. The picture is halved and smoothed (both 2 px wide or so), and a local peak of −det of the Hessian
    passes if its root is at least `share` of the local standard deviation (over 24 px) + `FLOOR`: the cells of pixels within 4.5 px of it
    along each axis are marked.
    """
    out = np.zeros([-(-n // CELL) for n in grey.shape], np.uint8)
    _sieve(np.ascontiguousarray(grey), share, FLOOR, out)
    return out.view(bool)


def every_cell(grey: Array) -> Array:
    """All cells of a picture or map (H, W), (⌈H/4⌉, ⌈W/4⌉) bool."""
    return np.ones([-(-n // CELL) for n in grey.shape], bool)
