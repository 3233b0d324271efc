"""Choice of corner (0, 0): the ordering contract of docs/conventions.md, for lattices of all patterns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.geometry.matrices import affine
from rcdn.geometry.rules import CHECKER, Rule
from rcdn.types import Array
from rcdn.types.arrays import Int


def ordered(ij: Array, xy: Array, colour: int, rule: Rule = CHECKER) -> Int[Array, "m 2"]:
    """Labels (M, 2) that obey the contract, from right-handed labels `ij` of corners at `xy`; the smallest are 0.

    `colour`: +1 if the cell of `ij`'s lattice at the label (0, 0) is bright, −1 if dark, 0 if unknown. A turn is
    admitted if the print says so (`_admitted_turns`); of several, the one that brings the i axis closest to +x is
    taken. An unambiguous board of squares (cols + rows odd) is labelled by its print alone: columns along its longer
    side, and the square inside the origin is dark, so that the same printed corner has the same label from every
    viewpoint.
    """
    turns = _admitted_turns(ij, colour, rule)
    turn = turns[0] if len(turns) == 1 else max(turns, key=lambda k: _rightward(rule.turned(ij, k), xy))
    return rule.started(rule.turned(ij, turn))


def _admitted_turns(ij: Array, colour: int, rule: Rule) -> Sequence[int]:
    """The turns after which the labels agree with the print; all of them if it does not tell."""
    every = range(len(rule.steps))
    if rule.sides == 3:  # each turn exchanges the colours; the triangles (0, 0), (1, 0), (0, 1) are dark
        return every[int(colour >= 0) :: 2]
    low, high = ij.min(axis=0).tolist(), ij.max(axis=0).tolist()
    cols, rows = high[0] - low[0] + 1, high[1] - low[1] + 1
    if rule.orientation(cols, rows) == "unique":
        squares = [(low[0], low[1]), (low[0], high[1] - 1), (high[0] - 1, high[1] - 1), (high[0] - 1, low[1])]
        for k in every[int(cols < rows) :: 2]:  # columns run along the longer side
            if colour * (-1) ** sum(squares[k]) < 0:  # the square inside the origin
                return [k]
    return every


def _rightward(ij: Array, xy: Array) -> float:
    """Cosine of the angle between the i axis and +x."""
    step = affine(ij, xy)[:, 0]
    return float(step[0] / max(np.linalg.norm(step, axis=0), 1e-12))
