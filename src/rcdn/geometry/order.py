"""Choice of corner (0, 0): the ordering contract of docs/conventions.md, for lattices of all patterns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.geometry.matrices import affine
from rcdn.geometry.rules import CHECKER, Rule
from rcdn.types import Array
from rcdn.types.arrays import Int, Real


def ordered(ij: Array, xy: Array, colour: int, rule: Rule = CHECKER) -> Int[Array, "m 2"]:
    """Labels (M, 2) that obey the contract, from right-handed labels `ij` of corners at `xy`; the smallest are 0.

    `colour`: +1 if the cell of `ij`'s lattice at the label (0, 0) is bright, −1 if dark, 0 if unknown. A turn is
    admitted if the print says so (`_admitted_turns`); of several, the one that brings the i axis closest to +x is
    taken. An unambiguous board of squares (cols + rows odd) is labelled by its print alone: columns along its longer
    side, and the square inside the origin is dark, so that the same printed corner has the same label from every
    viewpoint.
    """
    return rule.started(rule.turned(ij, turn_of(ij, xy, colour, rule)))


def turn_of(ij: Array, xy: Array, colour: int, rule: Rule = CHECKER) -> int:
    """The turn after which labels `ij` obey the contract, for the arguments of `ordered`."""
    turns = _admitted_turns(ij, colour, rule)
    return turns[0] if len(turns) == 1 else max(turns, key=lambda k: rightward(rule.turned(ij, k), xy))


def turn_labels(ij: Array, size: tuple[int, int], turn: int) -> Real[Array, "n 2"]:
    """Labels (N, 2) of a board of `size` after `turn` quarter turns."""
    box = np.array([(0, 0), (size[0] - 1, size[1] - 1)])
    return np.asarray(CHECKER.turned(ij, -turn) - CHECKER.turned(box, -turn).min(axis=0))


def colour_after(ij: Array, colour: int, turn: int) -> int:
    """The colour of the square inside (0, 0), of labels that are `ij` (M, 2) of a board of squares after `turn` turns,
    the smallest then 0; `colour` as in `ordered`."""
    (left, upper), (right, lower) = ij.min(axis=0).tolist(), ij.max(axis=0).tolist()
    squares = [(left, upper), (left, lower - 1), (right - 1, lower - 1), (right - 1, upper)]
    return colour * (-1) ** int(sum(squares[turn % 4]))


def _admitted_turns(ij: Array, colour: int, rule: Rule) -> Sequence[int]:
    """The turns after which the labels agree with the print; all of them if it does not tell."""
    every = range(len(rule.steps))
    if rule.sides == 3:  # each turn exchanges the colours; the triangles (0, 0), (1, 0), (0, 1) are dark
        return every[int(colour >= 0) :: 2]
    low, high = ij.min(axis=0).tolist(), ij.max(axis=0).tolist()
    cols, rows = high[0] - low[0] + 1, high[1] - low[1] + 1
    if rule.orientation(cols, rows) == "unique":
        for k in every[int(cols < rows) :: 2]:  # columns run along the longer side
            if colour_after(ij, colour, k) < 0:
                return [k]
    return every


def rightward(ij: Array, xy: Array) -> float:
    """Cosine of the angle between the i axis and +x."""
    step = affine(ij, xy)[:, 0]
    return float(step[0] / max(np.linalg.norm(step, axis=0), 1e-12))
