"""A board's lattice as it is projected: by a homography and, where the lens bends its lines, one coefficient of
distortion.

Extrapolating each line from its last three corners leaves its third differences out: .03 squares beside a board of few
squares tilted by 60°, and a tenth to a quarter of a square at the rim of a fisheye's picture, where whether a board
ends must be known to a fortieth. What the model leaves is small and smooth, and is extrapolated that way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.geometry.division import FEWEST, Division, division_of
from rcdn.targets.rectify import extrapolated, linear_weights, sampled_squares
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real


@dataclass(frozen=True, eq=False)
class ProjectedLattice:
    """A lattice of printed lines at `x` (C,) and `y` (R,): their crossings are mapped by `H`, distorted by `lens`
    (None: not at all), and shifted by `off` (R, C, 2) px, interpolated between crossings."""

    x: Array
    y: Array
    H: Array
    lens: Division | None
    off: Array

    def rectified(self, grey: Array, samples: int) -> Array:
        """`rectify.rectified` of the lattice, with squares in perspective and their sides bent as the lens bends
        them."""
        rows, columns = len(self.y) - 1, len(self.x) - 1
        down, across = linear_weights(rows, samples), linear_weights(columns, samples)
        printed = np.stack(np.meshgrid(across @ self.x, down @ self.y), axis=2)
        shift = np.einsum("ar,rcx,bc->abx", down, self.off, across, optimize=True)
        return sampled_squares(grey, _projected(self.H, self.lens, printed) + shift, rows, columns)


def projected_lattice(
    grid: Real[Array, "r c 2"], x: Real[Array, " c"], y: Real[Array, " r"], image_size: tuple[int, int]
) -> ProjectedLattice | None:
    """The lattice whose crossings of printed lines `x` (C,) and `y` (R,) were seen at `grid` (R, C, 2) px, NaN where
    they weren't; None if they are too few.

    `image_size` (width, height) px.
    """
    printed, known = np.stack(np.meshgrid(x, y), axis=2), np.isfinite(grid[..., 0])
    if known.sum() < FEWEST:
        return None
    lens = division_of(printed[known], grid[known], image_size)
    H = homography(printed[known], grid[known] if lens is None else lens.undistorted(grid[known]))
    off = np.full(grid.shape, np.nan)
    off[known] = grid[known] - _projected(H, lens, printed[known])
    return ProjectedLattice(x, y, H, lens, extrapolated(off))


def projected_board(
    grid: Real[Array, "r c 2"], found: Bool[Array, "r c"], image_size: tuple[int, int]
) -> ProjectedLattice | None:
    """The same for a `grid_with_ring` of a board of squares, of which only the corners that were `found` count; with
    one more line on each side."""
    seen = np.pad(np.where(found[..., None], grid, np.nan), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    rows, columns = seen.shape[:2]
    return projected_lattice(seen, np.arange(float(columns)), np.arange(float(rows)), image_size)


def _projected(H: Array, lens: Division | None, printed: Real[Array, "... 2"]) -> Real[Array, "... 2"]:
    xy = apply_homography(H, printed)
    return xy if lens is None else lens.distorted(xy)
