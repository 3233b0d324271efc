"""What the codes of a board say, whatever their kind."""

from __future__ import annotations

from dataclasses import dataclass

from rcdn.types import Target


@dataclass(frozen=True)
class Reading:
    """`turns` (quarters, counter-clockwise) after which the grid of the picture lies as its target is labelled;
    `place`: the label of its first corner then.

    `bits` of evidence, and their `margin` over the next possibility.
    """

    target: Target
    turns: int
    place: tuple[int, int]
    bits: float
    margin: float
