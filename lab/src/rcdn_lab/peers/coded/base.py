"""The interface of every reader of codes: the targets that it supports, and a function from a picture and its target to
corners with ids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rcdn.types import Array
from rcdn.types.target import AprilGrid, Charuco, Target


@dataclass(frozen=True, eq=False)
class Labelled:
    """A board with ids: `ids` (N,) as numbered on its target, `xy` (N, 2) px; `target`: the one that the reader
    identified, None where it was given."""

    ids: Array
    xy: Array
    target: Target | None = None


Read = Callable[[Array, Target], list[Labelled]]
"""(H, W) uint8 and the complete target → boards"""


@dataclass(frozen=True)
class CodedPeer:
    """Another reader of codes. `load` makes it, once per process; it does not raise if `missing` returns None.

    `reads`: whether it supports a target; `missing`: the reason why it cannot run here, or None.
    """

    name: str
    reads: Callable[[Target], bool]
    missing: Callable[[], str | None]
    version: Callable[[], str]
    load: Callable[[], Read]


def boards_of(ids: list[int], xy: list[Array]) -> list[Labelled]:
    """One board of all ids, or none if there are none."""
    return [Labelled(np.array(ids, int), np.array(xy, float).reshape(-1, 2))] if ids else []


def board_size(target: Charuco | AprilGrid) -> tuple[int, int]:
    """(columns, rows) of a completely known target; an unknown number of rows is an error of the caller."""
    if target.rows is None:
        raise ValueError(f"a reader must be told the rows of {target}")
    return target.columns, target.rows


def corners_of_tag(target: AprilGrid, tag: int) -> list[int]:
    """Ids of the corners of `tag`: bottom left, bottom right, top right, top left as it is printed; [] if the board
    does not have that tag."""
    columns, rows = board_size(target)
    row, column = divmod(tag - target.first_id, columns)
    if not 0 <= row < rows:
        return []
    first = 4 * columns * row + 2 * column
    return [first, first + 1, first + 2 * columns + 1, first + 2 * columns]
