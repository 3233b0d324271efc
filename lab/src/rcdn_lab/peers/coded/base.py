"""What every reader of codes is to the rest: what it can read, and a function from a picture and what it is told to numbered corners."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, Target


@dataclass(frozen=True, eq=False)
class Labelled:
    """A board with numbers: `ids` (N,) as its target counts, `xy` (N, 2) px; `target`: what the reader says that it is, None where it was told."""

    ids: Array
    xy: Array
    target: Target | None = None


Read = Callable[[Array, Target], list[Labelled]]
"""(H, W) uint8 and the target, all of it known, → boards"""


@dataclass(frozen=True)
class CodedPeer:
    """Another reader of codes. `load` makes it, once a process; it raises nothing if `missing` gives None.

    `reads`: can it read such a target; `missing`: why it can't run here, or None.
    """

    name: str
    reads: Callable[[Target], bool]
    missing: Callable[[], str | None]
    version: Callable[[], str]
    load: Callable[[], Read]


def boards_of(ids: list[int], xy: list[Array]) -> list[Labelled]:
    """One board of all numbers, or none if there are none."""
    return [Labelled(np.array(ids, int), np.array(xy, float).reshape(-1, 2))] if ids else []


def board_size(target: Charuco | AprilGrid) -> tuple[int, int]:
    """(columns, rows) of a target that is wholly known; a row that nobody told is an error of the caller."""
    if target.rows is None:
        raise ValueError(f"a reader must be told the rows of {target}")
    return target.columns, target.rows


def corners_of_tag(target: AprilGrid, tag: int) -> list[int]:
    """Numbers of the corners of `tag`: bottom left, bottom right, top right, top left as it is printed; [] if the board hasn't that tag."""
    columns, rows = board_size(target)
    row, column = divmod(tag - target.first_id, columns)
    if not 0 <= row < rows:
        return []
    first = 4 * columns * row + 2 * column
    return [first, first + 1, first + 2 * columns + 1, first + 2 * columns]
