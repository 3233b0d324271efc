"""Positions of the labels of a board's corners on its printed plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcdn.errors import RcdnError, shown
from rcdn.types.arrays import Int, Shaped
from rcdn.types.base import Array

Pattern = Literal["checker", "deltille", "aprilgrid"]
"""Pattern of a board: squares of two colours, equilateral triangles of two colours (a deltille), or tags with small
squares between them."""
ROW = 0.5 * 3**0.5
"""height of a deltille's triangle, the distance between its rows, in edges"""


def plane_points(ij: Shaped[Array, "... 2"], pattern: Pattern = "checker", gap: float | None = None) -> Array:
    """Positions (..., 2) of labels `ij` (..., 2) on their board, in squares; for a deltille in edges of its triangles,
    for tags in sides of a tag.

    A checkerboard's corner (i, j) lies at (i, j), a deltille's at (i + j/2, j·√3/2), since its axes are 60° apart. Tags
    begin at even labels and are `gap` apart, so that i is at ⌊i / 2⌋ (1 + gap) + (i mod 2). Fractional labels are
    interpolated linearly between corners. Raises RcdnError for tags without a gap.
    """
    ij = np.asarray(ij, np.float64)
    if pattern == "aprilgrid":
        if gap is None:
            raise RcdnError(
                "where the corners of an AprilGrid lie depends on its gap: ask its target (Board.points), or give one"
            )
        rest = ij % 2
        return np.asarray(ij // 2 * (1 + gap) + np.minimum(rest, 1) + np.maximum(rest - 1, 0) * gap)
    if pattern == "checker":
        return ij
    i, j = np.moveaxis(ij, -1, 0)
    return np.stack([i + 0.5 * j, ROW * j], axis=-1)


@dataclass(frozen=True)
class Plane:
    """The printed plane of a board: its pattern, and the `gap` between tags, in sides of a tag (None: unknown, or
    another pattern)."""

    pattern: Pattern = "checker"
    gap: float | None = None

    def __post_init__(self) -> None:
        if self.gap is not None and not 0 < self.gap < np.inf:
            raise RcdnError(f"Plane.gap must be a positive number of tags' sides, not {shown(self.gap)}")

    def points(self, ij: Int[Array, "... 2"]) -> Array:
        """Positions (..., 2) of labels `ij` (..., 2), in squares, edges of triangles, or sides of tags; see
        `plane_points`."""
        return plane_points(ij, self.pattern, self.gap)


SQUARES = Plane()
"""the plane of a checkerboard"""
