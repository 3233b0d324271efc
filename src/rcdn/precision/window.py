"""The pixels around each corner of a board, with their board coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.precision.lattice import Lattice
from rcdn.precision.model import Windows
from rcdn.types import Array

HALF = 0.5
"""squares; windows of neighbours touch but share no pixel, so that their errors are independent"""
LONGEST = 30.0
"""px along an edge: further out, its course is less certain than its pixels are worth"""
BAND = (4.0, 3.0)
"""pixels further from both edges than (blurs, + px) tell nothing"""
RIM = 2.2
"""blurs that a window stays away from what lies beyond the board's outermost squares"""
LEAST = 0.25
"""squares; no window is cut shorter than that"""
BATCH = 1 << 14
"""pixels of the corners that are fitted together: what they need at once fits into a core's cache"""


@dataclass(frozen=True, eq=False)
class Batch:
    """Pixels of some corners: `which` (n,) of the board's; `spot` (2, n, P) px from `centre` (n, 2); `value`, `weight` (n, P).

    float32; `weight` is 0 where a corner has fewer than P pixels.
    """

    which: Array
    centre: Array
    spot: Array
    value: Array
    weight: Array


def extent(maps: Lattice, xy: Array, rim: Array, blur: float) -> tuple[Array, Array, Array]:
    """Half extents (N, 2) of windows along u and v, squares; px (N, 2, 2) by squares; half sizes (N, 2) px of boxes that hold them.

    `rim` (N, 2) bool: no corner follows on one side along u, v. Raises LinAlgError where a map folds.
    """
    step = np.linalg.inv(maps.with_slopes(np.arange(len(xy)), xy)[1])
    if not np.isfinite(step).all():
        raise np.linalg.LinAlgError("a map folds on a corner")
    length = np.linalg.norm(step, axis=1)
    width = np.abs(np.linalg.det(step))[:, None] / length[:, ::-1]  # of a square, across the edge
    reach = np.minimum(HALF, LONGEST / length)
    reach = np.where(rim, np.clip(1 - RIM * blur / width, LEAST, reach), reach)
    return reach, step, np.ceil((np.abs(step) * reach[:, None]).sum(axis=2)).astype(np.int64)


def batches(grey: Array, maps: Lattice, xy: Array, rim: Array, blur: float, most: float = np.inf) -> list[Batch]:
    """The pixels that tell of the corners of a board at `xy` (N, 2) px of `grey` (H, W), corners with about as many of them together.

    `blur` px, about that of the picture, bounds the band along the edges from which pixels are taken. Pixels outside the
    image have none. `rim` as in `extent`. Where windows hold more than `most` pixels, every second, third, … is left.
    """
    reach, step, half = extent(maps, xy, rim, blur)
    slope = np.linalg.inv(step)
    band = np.minimum((BAND[0] * blur + BAND[1]) * np.linalg.norm(slope, axis=2), reach)
    area = 4 * (reach.prod(axis=1) - (reach - band).prod(axis=1)) * np.abs(np.linalg.det(step))
    thin = max(1, round(float(np.median(area)) / most))
    centre = np.rint(xy).astype(np.int64)
    order, out = np.argsort(-area, kind="stable"), []
    while len(order):
        which, order = np.split(order, [max(1, int(BATCH * thin / max(area[order[0]], 1)))])
        spots = _lattice_points(half[which].max(axis=0), thin)
        inside = _inside(slope[which], reach[which], band[which], spots)
        out.append(_batch(grey, which, centre[which], spots, inside))
    return out


def _lattice_points(half: Array, thin: int) -> Array:
    """Pixels (2, K) of a box, or every `thin`-th on a slanted lattice; x, y from its middle."""
    y, x = np.mgrid[-half[1] : half[1] + 1, -half[0] : half[0] + 1]
    keep = (x + (thin + 1) // 2 * y) % thin == 0
    return np.stack([x[keep], y[keep]])


def _inside(slope: Array, reach: Array, band: Array, spots: Array) -> Array:
    """Which `spots` (2, K) lie in the windows (n) and near one of their edges, (n, K), by the affine part of the maps."""
    uv = np.abs(slope.astype(np.float32) @ spots.astype(np.float32))
    reach, band = reach.astype(np.float32)[..., None], band.astype(np.float32)[..., None]
    return np.asarray((uv <= reach).all(axis=1) & (uv <= band).any(axis=1))


def _batch(grey: Array, which: Array, centre: Array, spots: Array, inside: Array) -> Batch:
    height, width = grey.shape
    low, high = centre + spots.min(axis=1), centre + spots.max(axis=1)
    if (low < 0).any() or (high >= (width, height)).any():
        x, y = centre[:, :, None].swapaxes(0, 1) + spots[:, None]
        inside = inside & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    count = inside.sum(axis=1)
    most = max(int(count.max()), 1)
    row, column = np.nonzero(inside)
    place = np.arange(len(row)) + np.repeat(np.arange(len(which)) * most - np.cumsum(count) + count, count)
    spread = lambda a: _scattered(a, place, (len(which), most))  # noqa: E731
    at = (centre[:, 1] * width + centre[:, 0])[row] + (spots[1] * width + spots[0])[column]
    spot = spots.astype(np.float32)[:, column]
    there = np.ones(len(row), np.float32)
    return Batch(which, centre, np.stack([spread(spot[0]), spread(spot[1])]), spread(grey.ravel()[at]), spread(there))


def _scattered(values: Array, place: Array, shape: tuple[int, int]) -> Array:
    out = np.zeros(shape, np.float32)
    out.ravel()[place] = values
    return out


def windows(maps: Lattice, batch: Batch) -> Windows:
    """The windows of a batch as `maps` see them."""
    u, v, gu, gv = maps.around(batch.which, batch.centre, *batch.spot)
    return Windows(batch.value, u, v, gu, gv, batch.weight, batch.spot)
