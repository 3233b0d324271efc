"""The pixels around each corner of a board, with their board coordinates."""

from __future__ import annotations

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
NEARLY = 1.3
"""share of its window that an affine map may miss"""
LEAST = 0.25
"""squares; no window is cut shorter than that"""


def extent(maps: Lattice, which: Array, xy: Array, rim: Array, blur: float) -> tuple[Array, int]:
    """Half extents (N, 2) of windows along u and v, squares, and the half size of pixel squares that hold them all.

    `rim` (N, 2) bool: no corner follows on one side along u, v.
    """
    step = np.linalg.inv(maps.with_slopes(which, xy)[1])
    length = np.linalg.norm(step, axis=1)
    width = np.abs(np.linalg.det(step))[:, None] / length[:, ::-1]  # of a square, across the edge
    reach = np.minimum(HALF, LONGEST / length)
    reach = np.where(rim, np.clip(1 - RIM * blur / width, LEAST, reach), reach)
    return reach, int(np.ceil((np.abs(step) * reach[:, None]).sum(axis=2).max())) + 1


def windows(grey: Array, maps: Lattice, which: Array, xy: Array, rim: Array, blur: float, thin: int = 1) -> Windows:
    """Windows around corners `which` (N,) of a board at `xy` (N, 2) px of `grey` (H, W).

    `blur` px, about that of the picture, bounds the band along the edges from which pixels are taken. Pixels outside the
    image have no weight. `rim` as in `extent`; `thin`: only every so-many-th of the pixels.
    """
    reach, half = extent(maps, which, xy, rim, blur)
    centre = np.rint(xy).astype(np.int64)
    span = np.arange(-half - 1, half + 2)
    spot = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    rough = spot @ maps.with_slopes(which, centre.astype(float))[1].swapaxes(1, 2)
    near = (np.abs(rough) < NEARLY * reach[:, None] + 2 / half * HALF).all(axis=-1)
    spot = spot[_first(np.asarray(near))]
    pixel = spot + centre[:, None]
    uv, slopes = maps.with_slopes(which, pixel.astype(float))
    slope = np.hypot(slopes[..., 0], slopes[..., 1])
    use = ((pixel >= 0) & (pixel < grey.shape[::-1])).all(axis=-1) & (np.abs(uv) <= reach[:, None]).all(axis=-1)
    use &= (np.abs(uv) < (BAND[0] * blur + BAND[1]) * slope).any(axis=-1)
    pick = _first(np.asarray(use))[:, ::thin]
    take = lambda a: np.take_along_axis(a, pick, axis=1).astype(np.float32)  # noqa: E731
    at = np.clip(pixel, 0, np.array(grey.shape[::-1]) - 1)
    return Windows(
        take(grey[at[..., 1], at[..., 0]]), take(uv[..., 0]), take(uv[..., 1]), take(slope[..., 0]), take(slope[..., 1]),
        take(use), np.take_along_axis(spot, pick[..., None], axis=1).astype(np.float32), centre,
    )  # fmt: skip


def _first(mask: Array) -> Array:
    """Indices (N, P) of the true elements of each row of `mask` (N, M), then of others, up to the longest row."""
    most = int(mask.sum(axis=1).max(initial=1))
    return np.argsort(~mask, axis=1, kind="stable")[:, :most]
