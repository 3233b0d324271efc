"""A board's lattice under a lens that bends its lines: predicted by a homography and one coefficient of distortion.

Extrapolating each line from its last three corners leaves its fourth differences out: a tenth to a quarter of a square
at the rim of a fisheye's picture, where whether a board ends must be known to a fortieth. What the model leaves is
small and smooth, and is extrapolated as before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.geometry.division import Division, division_of
from rcdn.targets.rectify import extrapolated, linear_weights, sampled_squares
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real


@dataclass(frozen=True, eq=False)
class BentLines:
    """A lattice of printed lines at `x` (C,) and `y` (R,): their crossings are mapped by `H`, distorted by `lens`, and
    shifted by `off` (R, C, 2) px, interpolated between crossings."""

    x: Array
    y: Array
    H: Array
    lens: Division
    off: Array

    def rectified(self, grey: Array, samples: int) -> Array:
        """`rectify.rectified` of the lattice, with the sides of its squares bent as the lens bends them."""
        rows, columns = len(self.y) - 1, len(self.x) - 1
        down, across = linear_weights(rows, samples), linear_weights(columns, samples)
        printed = np.stack(np.meshgrid(across @ self.x, down @ self.y), axis=2)
        shift = np.einsum("ar,rcx,bc->abx", down, self.off, across, optimize=True)
        xy = self.lens.distorted(apply_homography(self.H, printed)) + shift
        return sampled_squares(grey, xy, rows, columns)


def bent_lines(
    grid: Real[Array, "r c 2"], x: Real[Array, " c"], y: Real[Array, " r"], image_size: tuple[int, int]
) -> BentLines | None:
    """The lattice whose crossings of printed lines `x` (C,) and `y` (R,) were seen at `grid` (R, C, 2) px, NaN where
    they weren't; None where no lens is seen to bend its lines.

    `image_size` (width, height) px.
    """
    printed, known = np.stack(np.meshgrid(x, y), axis=2), np.isfinite(grid[..., 0])
    lens = division_of(printed[known], grid[known], image_size)
    if lens is None:
        return None
    H = homography(printed[known], lens.undistorted(grid[known]))
    off = np.full(grid.shape, np.nan)
    off[known] = grid[known] - lens.distorted(apply_homography(H, printed[known]))
    return BentLines(x, y, H, lens, extrapolated(off))


def bent_board(grid: Real[Array, "r c 2"], found: Bool[Array, "r c"], image_size: tuple[int, int]) -> BentLines | None:
    """The same for a `grid_with_ring` of a board of squares, of which only the corners that were `found` count; with
    one more line on each side."""
    seen = np.pad(np.where(found[..., None], grid, np.nan), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    rows, columns = seen.shape[:2]
    return bent_lines(seen, np.arange(float(columns)), np.arange(float(rows)), image_size)
