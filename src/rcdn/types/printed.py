"""Printable targets with their scale: every target as data, and the positions of its corners in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.types.arrays import Real, Shaped
from rcdn.types.base import Array
from rcdn.types.plane import plane_points
from rcdn.types.ranges import SPACING, grid_size, in_words, is_spacing
from rcdn.types.target import PUZZLE, AprilGrid, Charuco, PuzzleBoard, grid_of, numbers

LEAST_CORNERS = 2
"""smallest number of corners along a side of a board"""


@dataclass(frozen=True)
class Checkerboard:
    """A plain board of squares with `columns` × `rows` inner corners, numbered row by row; the square above and to the
    left of the first corner is black."""

    columns: int
    rows: int
    kind: ClassVar[str] = "checkerboard"

    def __post_init__(self) -> None:
        grid_size((self.columns, self.rows), "a checkerboard's size", LEAST_CORNERS)

    def __str__(self) -> str:
        return f"checkerboard of {self.columns}x{self.rows} inner corners"

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at labels `ij` (N, 2)."""
        return np.asarray(self.columns * ij[:, 1] + ij[:, 0])

    def ij_of(self, ids: Shaped[Array, " n"]) -> Real[Array, "n 2"]:
        """The labels (N, 2) of the corners with the numbers `ids` (N,). Raises RcdnError for unknown numbers."""
        ids = numbers(ids, self.columns * self.rows, self)
        return np.stack([ids % self.columns, ids // self.columns], axis=1)

    def places(self) -> Real[Array, "n 2"]:
        """The labels (N, 2) of all its corners, in ascending order of their numbers."""
        return grid_of(self.columns, self.rows)

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Positions (..., 2) of labels `ij` (..., 2) on the board, in squares."""
        return plane_points(ij)


@dataclass(frozen=True)
class Deltille:
    """A plain board of triangles: `rows` rows of `columns` inner corners each, every other row offset by half a side.

    Corners are numbered row by row. Labels count along two sides of a triangle, so that row j begins at i = −⌊j / 2⌋;
    the triangle between (0, 0), (1, 0) and (0, 1) is black.
    """

    columns: int
    rows: int
    kind: ClassVar[str] = "deltille"

    def __post_init__(self) -> None:
        grid_size((self.columns, self.rows), "a deltille's size", LEAST_CORNERS)

    def __str__(self) -> str:
        return f"deltille of {self.columns}x{self.rows} inner corners"

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at labels `ij` (N, 2)."""
        return np.asarray(self.columns * ij[:, 1] + ij[:, 0] + ij[:, 1] // 2)

    def ij_of(self, ids: Real[Array, " n"]) -> Real[Array, "n 2"]:
        """The labels (N, 2) of the corners with the numbers `ids` (N,). Raises RcdnError for unknown numbers."""
        ids = numbers(ids, self.columns * self.rows, self)
        row = ids // self.columns
        return np.stack([ids % self.columns - row // 2, row], axis=1)

    def places(self) -> Real[Array, "n 2"]:
        """The labels (N, 2) of all its corners, in ascending order of their numbers."""
        return self.ij_of(np.arange(self.columns * self.rows))

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Positions (..., 2) of labels `ij` (..., 2) on the board, in sides of a triangle."""
        return plane_points(ij, "deltille")


@dataclass(frozen=True)
class PuzzlePart:
    """A rectangle of the PuzzleBoard's code of 501 × 501: `columns` × `rows` corners, the first of which is at
    (`column`, `row`) of the code.

    Numbers and positions are those of the whole code, 501 · row + column; a part does not extend beyond the end of the
    code.
    """

    columns: int
    rows: int
    column: int = 0
    row: int = 0
    kind: ClassVar[str] = "puzzleboard"

    def __post_init__(self) -> None:
        grid_size((self.columns, self.rows), "a PuzzleBoard's size", LEAST_CORNERS)
        for name, first, count in (("column", self.column, self.columns), ("row", self.row, self.rows)):
            if count > PUZZLE:
                raise ConfigError(f"a PuzzleBoard has at most {PUZZLE} {name}s of corners, not {count}")
            if type(first) is not int or not 0 <= first <= PUZZLE - count:
                raise ConfigError(
                    f"a PuzzleBoard's first {name} must be a whole number from 0 to {PUZZLE - count}, "
                    f"so that {count} {name}s end with the code, not {shown(first)}"
                )

    def __str__(self) -> str:
        return f"PuzzleBoard {self.columns}x{self.rows} from {self.column},{self.row}"

    @property
    def whole(self) -> PuzzleBoard:
        """The target as which a picture of this part is read."""
        return PuzzleBoard()

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at positions `ij` (N, 2) of the code."""
        return self.whole.ids(ij)

    def ij_of(self, ids: Real[Array, " n"]) -> Real[Array, "n 2"]:
        """The positions (N, 2) in the code of the corners with the numbers `ids` (N,). Raises RcdnError for numbers
        that are not on this part."""
        ij = self.whole.ij_of(ids)
        inside = ((ij >= (self.column, self.row)) & (ij < (self.column + self.columns, self.row + self.rows))).all(
            axis=1
        )
        if not inside.all():
            raise RcdnError(f"ids holds {np.asarray(ids)[~inside][0]}, which is no corner of the {self}")
        return ij

    def places(self) -> Real[Array, "n 2"]:
        """The positions (N, 2) in the code of all its corners, in ascending order of their numbers."""
        return grid_of(self.columns, self.rows) + np.array([self.column, self.row])

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Points (..., 2) at positions `ij` (..., 2) of the code, in squares from the first corner of the code."""
        return plane_points(ij)


Print = Checkerboard | Deltille | Charuco | AprilGrid | PuzzlePart
"""everything that can be printed on a sheet"""


@dataclass(frozen=True)
class Printed:
    """A `target` at its scale: `spacing`, m, is the side of a square, of a triangle, or of a tag.

    Its frame is that of `Board.points` × spacing, in which poses are given: origin at the corner with label (0, 0), x
    along i, y along j, z away from a viewer of the front. The origin of OpenCV's frame of a ChArUco board is one square
    before, on both axes. Kalibr's frame of an AprilGrid has its origin at the bottom left, x to the right, y upwards
    and z towards a viewer of the front. Raises ConfigError for an invalid spacing.
    """

    target: Print
    spacing: float

    def __post_init__(self) -> None:
        if not is_spacing(self.spacing):
            raise ConfigError(
                f"Printed.spacing must be a length above 0, {in_words(*SPACING)} m, such as 0.025, "
                f"not {shown(self.spacing)}"
            )

    @property
    def ids(self) -> Real[Array, " n"]:
        """The numbers (N,) of all corners, as counted by the target's own tools, in ascending order."""
        return self.target.ids(self.target.places())

    def points(self, ids: Any = None) -> Array:
        """Positions (N, 2), m, of the corners with the numbers `ids` (N,); by default of all corners, in the order of
        `self.ids`.

        Raises RcdnError for numbers that don't exist on the target.
        """
        ij = self.target.places() if ids is None else self.ij_of(ids)
        return self.target.plane(ij) * self.spacing

    def ij_of(self, ids: Any) -> Real[Array, "n 2"]:
        """The labels (N, 2) of the corners with the numbers `ids` (N,). Raises RcdnError for numbers that don't exist
        on the target."""
        return self.target.ij_of(np.asarray(ids))
