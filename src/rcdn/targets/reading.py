"""The result of decoding a board, for any kind of target."""

from __future__ import annotations

from dataclasses import dataclass

from rcdn.types import Target


@dataclass(frozen=True)
class Reading:
    """The decoded `target` of a board.

    `turns`: counter-clockwise quarter turns that bring the grid of the picture to the orientation of the target's
    labels; `place`: the label of the first corner of the rotated grid; `bits` of evidence, and their `margin` over
    the next hypothesis; `contradicted`: codes that are read with certainty are others than the target has there, so
    that the reading gives no numbers.
    """

    target: Target
    turns: int
    place: tuple[int, int]
    bits: float
    margin: float
    contradicted: bool = False
