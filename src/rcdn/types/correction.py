"""Smooth deviation of a lens from its parametric model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze, shape_of

DEGREE = 3
"""degree of the splines"""


@dataclass(frozen=True, eq=False)
class LensCorrection(Value):
    """A smooth displacement that is added to the distorted point of a parametric lens model, before K.

    `control` (rows, columns, 2): control points of a uniform bicubic B-spline, in focal lengths, over the stereographic
    plane u = 2·(x, y) ÷ (|p| + z) of a camera point p, as in mrcal's splined stereographic models. `extent` (2,): the
    spline's domain is [−extent[0], extent[0]] × [−extent[1], extent[1]] in u; the basis function of control point
    (row, column) has its peak at u = ((column − (columns − 1) / 2)·h₀, (row − (rows − 1) / 2)·h₁) with the sides
    h = 2·extent ÷ (columns − 3, rows − 3) of a cell, so that one row and column of control points lie outside of each
    border. Beyond the domain the displacement is that of the point where the line from the centre leaves the domain: if
    the lens model increases outward and the map is not folded at the border, it isn't folded beyond it either.
    """

    control: Array
    extent: Array

    def __post_init__(self) -> None:
        shape = shape_of(self.control, "LensCorrection.control")
        if len(shape) != 3 or shape[2] != 2 or min(shape[:2]) <= DEGREE:
            raise RcdnError(f"LensCorrection.control must have shape (rows ≥ 4, columns ≥ 4, 2), not {shape}")
        freeze(self, "control", self.control, np.float64, shape[1:])
        freeze(self, "extent", self.extent, np.float64, ())
        if self.extent.shape != (2,) or not (np.isfinite(self.extent) & (self.extent > 0)).all():
            raise RcdnError(f"LensCorrection.extent must hold two positive numbers, not {self.extent.tolist()}")

    def __repr__(self) -> str:
        rows, columns, _ = self.control.shape
        x, y = self.extent.tolist()
        return f"<LensCorrection {columns}×{rows} control points, ±{x:.3g} × ±{y:.3g}>"

    @property
    def cells(self) -> Real[Array, " 2"]:
        """(2,) number of cells of the domain along x and y."""
        rows, columns, _ = self.control.shape
        return np.array([columns - DEGREE, rows - DEGREE])

    @property
    def sides(self) -> Real[Array, " 2"]:
        """(2,) sides of a cell in u along x and y."""
        return np.asarray(2 * self.extent / self.cells)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the control points, row by row, x before y: `s03x`; if the grid has more than ten rows or columns,
        `s12_3x`."""
        rows, columns, _ = self.control.shape
        gap = "_" if max(rows, columns) > 10 else ""
        return tuple(f"s{r}{gap}{c}{axis}" for r in range(rows) for c in range(columns) for axis in "xy")

    def with_control(self, control: Array) -> LensCorrection:
        """The same grid with other control points, (rows, columns, 2) or flat."""
        control = np.asarray(control, float)
        if control.size != self.control.size:
            raise RcdnError(
                f"LensCorrection takes {self.control.size} numbers for its control points, not {control.size}"
            )
        return LensCorrection(control.reshape(self.control.shape), self.extent)
