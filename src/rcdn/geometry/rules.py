"""Rules of the lattices of the patterns: what a label's neighbours are, how labels turn,
and what the colours leave open.

A lattice has K directions, each with a step forth and one back: 2 for squares and for tags, 3 for triangles. All that
the recovery of boards knows about a pattern's labels follows from the steps and from the number of a cell's corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rcdn.types import Array, Orientation
from rcdn.types.arrays import Shaped
from rcdn.types.plane import Pattern

Label = tuple[int, int]


@dataclass(frozen=True)
class Rule:
    """The lattice of a pattern.

    `steps`: changes of a label (u, v) by a step to each of the 2 K neighbours, by rising angle, (1, 0) and (0, 1)
    first. `sides`: number of corners of a cell. `period`: labels whose differences are multiples of it have the same
    surroundings up to colour: 2 where long and short steps alternate, long ones beginning at even labels.
    """

    pattern: Pattern
    steps: tuple[Label, ...]
    sides: int
    period: int = 1

    def turn(self, u: Any, v: Any, turns: int) -> tuple[Any, Any]:
        """The label (u, v), integers or arrays, after `turns` turns by the angle from one step to the next. A turned
        lattice has the same handedness."""
        (a, b), (c, d) = (self.steps[(turns + k) % len(self.steps)] for k in (0, 1))
        return u * a + v * c, u * b + v * d

    def turned(self, ij: Shaped[Array, "*n 2"], turns: int) -> Array:
        """`turn` for labels (..., 2)."""
        return np.stack(self.turn(ij[..., 0], ij[..., 1], turns), axis=-1)

    def started(self, ij: Shaped[Array, "n 2"]) -> Array:
        """Labels (N, 2) shifted by multiples of the period so that the smallest are 0, or less than a period."""
        return np.asarray(ij - ij.min(axis=0) // self.period * self.period)

    @cached_property
    def corner(self) -> int:
        """Number of turns from one side of a cell to the next, on the way around it."""
        return len(self.steps) // self.sides

    @cached_property
    def cells(self) -> tuple[tuple[Label, ...], ...]:
        """For each cell that counts as a label's own: the steps from the label to its other corners, in order."""
        out = []
        for first in range(self.corner):
            at, ring = (0, 0), []
            for side in range(self.sides - 1):
                d, e = self.steps[(first + side * self.corner) % len(self.steps)]
                at = (at[0] + d, at[1] + e)
                ring.append(at)
            out.append(tuple(ring))
        return tuple(out)

    def orientation(self, cols: int, rows: int) -> Orientation:
        """Which labellings the colours of a board of `cols` × `rows` corners leave open.

        Squares, cols + rows odd: a single one. Even: the board is symmetric under a half turn; a square of an even size
        under quarter turns, too. Triangles of one colour are symmetric under a third of a turn; tags have no colours.
        """
        if self.pattern == "deltille":
            return "ambiguous_120"
        if self.pattern == "aprilgrid":
            return "ambiguous_90"
        if (cols + rows) % 2:
            return "unique"
        return "ambiguous_90" if cols == rows and cols % 2 == 0 else "ambiguous_180"


CHECKER = Rule("checker", ((1, 0), (0, 1), (-1, 0), (0, -1)), 4)
TAGS = Rule("aprilgrid", CHECKER.steps, 4, period=2)
TRIANGLES = Rule("deltille", ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)), 3)
