"""Shape of a real board, which deviates from the ideal by errors of its print and by not being flat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze, shape_of


@dataclass(frozen=True, eq=False)
class BoardShape(Value):
    """`offsets` (rows, columns, 3) m: displacement of each inner corner of a board from its ideal position, along the
    board's x, y and normal (away from the camera). It is the same in all views. Mean translation, rotation, scale and
    tilt are removed from the offsets, since they can't be separated from the board's pose."""

    offsets: Array

    def __post_init__(self) -> None:
        found = shape_of(self.offsets, "BoardShape.offsets")
        if len(found) != 3 or found[2] != 3:
            raise RcdnError(f"BoardShape.offsets must have shape (rows, columns, 3), not {found}")
        freeze(self, "offsets", self.offsets, np.float64, found[1:])
        if not np.isfinite(self.offsets).all():
            raise RcdnError("BoardShape.offsets must be finite")

    def __repr__(self) -> str:
        sizes = f": bend {self.bend:.3g} m, print error {self.print_error:.3g} m" if self.offsets.size else ""
        return f"<BoardShape {self.size[0]}×{self.size[1]} corners{sizes}>"

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of inner corners."""
        return self.offsets.shape[1], self.offsets.shape[0]

    @property
    def bend(self) -> float:
        """Range of the corners' offsets along the normal, from the lowest to the highest, m."""
        return float(np.ptp(self.offsets[:, :, 2]))

    @property
    def print_error(self) -> float:
        """Root mean square of the corners' offsets within the plane, m."""
        return float(np.sqrt((self.offsets[:, :, :2] ** 2).sum(axis=2).mean()))

    @property
    def stretch(self) -> float:
        """Difference between the mean spacing of columns and that of rows, m (÷ spacing: relative)."""
        x, y = np.meshgrid(np.arange(self.size[0]), np.arange(self.size[1]))
        plane = np.stack([np.ones(x.size), x.ravel(), y.ravel()], axis=1)
        along = np.linalg.lstsq(plane, self.offsets[:, :, :2].reshape(-1, 2), rcond=None)[0]
        return float(along[1, 0] - along[2, 1])

    def at(self, ij: Real[Array, "n 2"]) -> Real[Array, "n 3"]:
        """Offsets (N, 3), m, at the labels `ij` (N, 2) (column, row). Raises RcdnError for labels beyond the board."""
        ij = np.asarray(ij)
        if len(ij) and not ((ij >= 0).all() and (ij < self.size).all()):
            raise RcdnError(f"ij must lie on the board of {self.size[0]}×{self.size[1]} corners")
        return np.asarray(self.offsets[ij[:, 1], ij[:, 0]])
