"""What a real board is like: printed a little unevenly, and not quite flat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types.arrays import Int, Real
from rcdn.types.base import Array, Value, freeze, shape_of


@dataclass(frozen=True, eq=False)
class BoardShape(Value):
    """`offsets` (rows, columns, 3) m: how far each inner corner of a board lies off its place on the perfect plane, along the board's x, y and
    normal (away from the camera). The same in all views. A shift, a turn, another size and a tilt, as the mean slopes of the offsets tell them,
    aren't in it: they belong to the board's pose."""

    offsets: Array

    def __post_init__(self) -> None:
        found = shape_of(self.offsets, "BoardShape.offsets")
        if len(found) != 3 or found[2] != 3:
            raise RcdnError(f"BoardShape.offsets must have shape (rows, columns, 3), not {found}")
        freeze(self, "offsets", self.offsets, np.float64, found[1:])
        if not np.isfinite(self.offsets).all():
            raise RcdnError("BoardShape.offsets must be finite")

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of inner corners."""
        return self.offsets.shape[1], self.offsets.shape[0]

    @property
    def bend(self) -> float:
        """How far corners lie out of the plane, m, from the lowest to the highest."""
        return float(np.ptp(self.offsets[:, :, 2]))

    @property
    def print_error(self) -> float:
        """Root mean square distance of corners from their places within the plane, m."""
        return float(np.sqrt((self.offsets[:, :, :2] ** 2).sum(axis=2).mean()))

    @property
    def stretch(self) -> float:
        """By how much columns are wider apart than rows, per corner, m (÷ spacing: as a share)."""
        x, y = np.meshgrid(np.arange(self.size[0]), np.arange(self.size[1]))
        plane = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
        along = np.linalg.lstsq(plane, self.offsets[:, :, :2].reshape(-1, 2), rcond=None)[0]
        return float(along[1, 0] - along[2, 1])

    def at(self, ij: Int[Array, "n 2"]) -> Real[Array, "n 3"]:
        """(N, 3) m at the labels `ij` (N, 2) (column, row). Raises RcdnError for labels beyond the board."""
        ij = np.asarray(ij)
        if len(ij) and not ((ij >= 0).all() and (ij < self.size).all()):
            raise RcdnError(f"ij must lie on the board of {self.size[0]}×{self.size[1]} corners")
        return np.asarray(self.offsets[ij[:, 1], ij[:, 0]])
