"""Refinement on the picture with windows that follow the size of the squares (the `auto` preset)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rcdn.corners.saddle import rochade, smooth_fit, surface_fit
from rcdn.corners.symmetry import symmetry_centre
from rcdn.types import Array

LONE_PITCH = 20.0
"""Distance to the next corner that is assumed for a corner without one, px."""
FIT_LEVELS = np.array([2, 3, 4, 6, 8])
FIT_SHARE = 0.4
"""Half window of the surface fit, share of the pitch."""
DISC_SHARE = 0.45
"""Radius of the symmetry disc, share of the pitch: it stops short of the neighbours' edges."""
DISC_RANGE = (2, 10)


def nearest_pitch(xy: Array) -> Array:
    """Distance (N,) px from each of `xy` (N, 2) to the nearest other one; `LONE_PITCH` for a single corner."""
    if len(xy) < 2:
        return np.full(len(xy), LONE_PITCH)
    return cKDTree(xy).query(xy, k=2)[0][:, 1]


def adaptive_fit(grey: Array, seeds: Array, pitch: Array | None = None, careful: Array | None = None) -> Array:
    """Corners (N, 2) px of `grey` (H, W) near integer `seeds` (N, 2); NaN where there is no saddle.

    First a weighted surface fit, which finds the corner from over a pixel away, then the centre of point symmetry,
    which is more precise; where the second fails, the first stands. `pitch` (N,) px, the distance to the nearest
    neighbouring corner, sets both windows; not finite or None: measured among the seeds. `careful` (N,) bool: which corners get the
    second step (None: all).
    """
    seeds = np.asarray(seeds, np.int64).reshape(-1, 2)
    pitch = nearest_pitch(seeds) if pitch is None else np.asarray(pitch, np.float64)
    pitch = np.where(np.isfinite(pitch), pitch, LONE_PITCH)
    level = np.maximum(np.searchsorted(FIT_LEVELS, FIT_SHARE * pitch, side="right") - 1, 0)
    xy = _fit_levels(grey, seeds, level)
    lost = np.isnan(xy).any(axis=1)  # neighbours in the window, at a steep tilt, or too few pixels in it
    xy[lost] = surface_fit(grey, seeds[lost], rochade(2))
    careful = np.ones(len(xy), bool) if careful is None else careful
    radius = np.clip(np.rint(DISC_SHARE * pitch), *DISC_RANGE).astype(int)
    xy[careful] = _polish(grey, xy[careful], radius[careful])
    return xy


def _fit_levels(grey: Array, seeds: Array, level: Array) -> Array:
    xy = np.full(seeds.shape, np.nan)
    for index in np.unique(level):
        mine = level == index
        xy[mine] = surface_fit(grey, seeds[mine], smooth_fit(int(FIT_LEVELS[index])))
    return xy


def _polish(grey: Array, xy: Array, radius: Array) -> Array:
    found = np.isfinite(xy).all(axis=1)
    for half in np.unique(radius[found]):
        mine = found & (radius == half)
        better = symmetry_centre(grey, xy[mine], int(half))
        xy[mine] = np.where(np.isfinite(better), better, xy[mine])
    return xy
