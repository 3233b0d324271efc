"""Refinement on the picture with windows in proportion to the size of the squares (the `auto` preset)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.corners.patches import plain
from rcdn.corners.saddle import Fit, rochade, smooth_fit, surface_fit, surface_fits
from rcdn.corners.symmetry import symmetry_centre
from rcdn.geometry.near import nearest
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

LONE_PITCH = 20.0
"""Distance to the nearest neighbour that is assumed for a single corner, px."""
FIT_LEVELS = (2, 3, 4, 6, 8)
"""Half windows of the surface fits that are made, px."""
FIT_SHARE = 0.4
"""Half window of the surface fit, share of the pitch."""
DISC_SHARE = 0.45
"""Radius of the symmetry disc, share of the pitch: the disc ends before the neighbours' edges."""
DISC_RANGE = (2, 10)
"""Its limits, px."""


def nearest_pitch(xy: Shaped[Array, "n 2"]) -> Real[Array, " n"]:
    """Distance (N,) px from each of `xy` (N, 2) to the nearest other one; `LONE_PITCH` for a single corner."""
    if len(xy) < 2:
        return np.full(len(xy), LONE_PITCH)
    return nearest(xy, xy, 2)[0][:, 1]


def adaptive_fit(
    grey: Shaped[Array, "h w"],
    seeds: Shaped[Array, "n 2"],
    pitch: Real[Array, " n"] | None = None,
    careful: Array | None = None,
) -> Real[Array, "n 2"]:
    """Corners (N, 2) px of `grey` (H, W) near integer `seeds` (N, 2); NaN where there is no saddle.

    First a weighted surface fit, which converges from more than a pixel away, then the centre of point symmetry, which
    is more precise; where the second fails, the result of the first is kept. `pitch` (N,) px, the distance to the
    nearest neighbouring corner, determines both windows: `LONE_PITCH` where it isn't finite; None: measured among the
    seeds. `careful` (N,) bool: the corners that get the second step (None: all).
    """
    seeds = np.asarray(seeds, np.int64).reshape(-1, 2)
    pitch = nearest_pitch(seeds) if pitch is None else np.asarray(pitch, np.float64)
    pitch = np.where(np.isfinite(pitch), pitch, LONE_PITCH)
    grey = plain(grey)
    level = np.searchsorted(FIT_LEVELS[1:], FIT_SHARE * pitch, side="right")
    xy = surface_fits(grey, seeds, _fits(), level)
    lost = np.isnan(xy[:, 0])  # at a steep tilt the window includes neighbours, or it has too few pixels
    if lost.any():
        xy[lost] = surface_fit(grey, seeds[lost], rochade(2))
    polish = ~np.isnan(xy[:, 0]) if careful is None else careful & ~np.isnan(xy[:, 0])
    if polish.any():
        xy[polish] = _polished(grey, xy[polish], pitch[polish])
    return xy


@lru_cache(maxsize=1)
def _fits() -> tuple[Fit, ...]:
    return tuple(smooth_fit(half) for half in FIT_LEVELS)


def _polished(grey: Array, xy: Array, pitch: Array) -> Array:
    radius = np.clip(np.rint(DISC_SHARE * pitch), *DISC_RANGE).astype(np.int64)
    better = symmetry_centre(grey, xy, radius)
    return np.where(np.isnan(better), xy, better)
