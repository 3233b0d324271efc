"""The centre of point symmetry, or of antisymmetry, of a corner's surroundings.

Two straight edges that cross look the same after half a turn about their crossing, for any angle, contrast and (even)
blur; perspective preserves that, as long as the window does not reach the next edges. Equating I(c + d) and I(c − d)
over a window uses the whole length of the edges, not only the middle, and no model of the grey levels: with white noise
and known gradients its variance is the bound for any estimator of the crossing. Schöps et al. 2020 ("Why having 10,000
parameters in your camera model is better than twelve"), section 3, use the same cost with a homography from the known
board.

Where three edges cross, as in a deltille, opposite sectors have opposite colours, and half a turn gives the negative:
I(c + d) + I(c − d) is the same constant for all d. The constant itself is unknown and is eliminated by subtracting the
mean over the window.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.corners.patches import plain
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

_room = lru_cache(bind("rcdn_symmetry_room"))
_kernel = bind("rcdn_symmetry_centre")


def symmetry_centre(
    grey: Shaped[Array, "h w"],
    start: Shaped[Array, "n 2"],
    half: int | Array,
    repeats: int = 10,
    done: float = 0.003,
    anti: bool = False,
) -> Real[Array, "n 2"]:
    """Centres of symmetry (`anti`: of antisymmetry) (N, 2) px of `grey` (H, W) near `start` (N, 2) px.

    `half`: radius of the disc around each centre, px, one number or (N,). Gauss–Newton steps of at most 1 px until they
    are shorter than `done`, on the picture smoothed by a Gaussian of 1 px, which makes the error of linear
    interpolation negligible and the gradients usable in noise. NaN where the window has no edges, or edges of one
    direction only, where the steps have not converged after `repeats`, or where the centre is more than
    max(1, half / 2) px from the start.
    """
    start = np.ascontiguousarray(start, np.float64).reshape(-1, 2)
    xy = np.empty(start.shape)
    if not len(start):
        return xy
    half = np.full(len(start), half) if isinstance(half, int) else np.ascontiguousarray(half, np.int64)
    work = np.zeros(_room(int(half.max())), np.float32)
    _kernel(plain(grey), start, half, repeats, done, anti, work, xy)
    return xy
