"""The one grid that a corners.vnl holds, and which corner of each board stands where in it.

Boards whose codes were read have a place on the target, so that each part of it that is seen is written there. Other boards are written whole.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from rcdn.errors import FormatError
from rcdn.types import AprilGrid, Array, Board, Charuco, usual_size
from rcdn.types.ranges import BOX

Size = tuple[int, int]
Key = tuple[object, ...]


@dataclass(frozen=True)
class VnlGrid:
    """A grid of `size` (columns, rows), of whole boards if `key` is None; else of boards of that target, whose corner `first` (i, j) is the first one
    before it is `turned` by a quarter, if it is."""

    size: Size
    key: Key | None = None
    first: Size = (0, 0)
    turned: bool = False

    def positions(self, board: Board) -> Array | None:
        """The board's corners on this grid (rows, columns, 2), NaN where none is; None if it isn't one of this grid's boards."""
        if self.key is None:
            return None if board.pattern == "aprilgrid" else board.grid_of(self.size)
        if key_of(board) != self.key:
            return None
        columns, rows = self.size[::-1] if self.turned else self.size
        i, j = (board.ij - self.first).T
        if not ((i >= 0) & (i < columns) & (j >= 0) & (j < rows)).all():
            return None
        grid = np.full((rows, columns, 2), np.nan)
        grid[j, i] = board.xy
        return np.rot90(grid) if self.turned else grid


@dataclass
class _Seen:
    """What is seen of one target: how many `boards`, their `low`est and `high`est labels; how often it was so many `rows` of corners high."""

    boards: int = 0
    low: list[int] = field(default_factory=lambda: [BOX, BOX])
    high: list[int] = field(default_factory=lambda: [0, 0])
    rows: Counter[int] = field(default_factory=Counter)

    def add(self, board: Board) -> None:
        self.boards += 1
        self.low = np.minimum(self.low, board.ij.min(axis=0)).tolist()
        self.high = np.maximum(self.high, board.ij.max(axis=0)).tolist()
        if isinstance(board.target, Charuco) and board.target.rows is not None:
            self.rows[board.target.rows - 1] += 1


def key_of(board: Board) -> Key | None:
    """What boards with places on the same plane of equal squares have in common; None of one that has no such place."""
    target = board.target
    if target is None or isinstance(target, AprilGrid):
        return None
    if isinstance(target, Charuco):
        family = re.sub("_[0-9]+$", "", target.dictionary)  # of parts of a board the smaller dictionaries are known
        return target.kind, family, target.columns, target.first_id, target.legacy, target.inverted
    return (target.kind,)


def grid_for(pictures: Iterable[Iterable[Board]], size: Size | None) -> VnlGrid | None:
    """The grid of most of the boards of `pictures`; `size` (columns, rows): the one it must have, if that is known. None if there are no boards.

    Raises FormatError if it can't be told.
    """
    seen: dict[Key, _Seen] = {}
    whole: Counter[Size] = Counter()
    patterns: set[str] = set()

    def plain_boards() -> Iterator[Board]:
        for board in chain.from_iterable(pictures):
            patterns.add(board.pattern)
            if (key := key_of(board)) is not None:
                seen.setdefault(key, _Seen()).add(board)
            elif board.pattern != "aprilgrid":
                whole[board.size] += board.complete
                yield board

    usual = usual_size(plain_boards())
    if patterns == {"aprilgrid"}:
        raise FormatError("corners.vnl is for grids of even steps, and those of an AprilGrid aren't even; write JSON")
    usual = size or usual
    plain = sum(many for shape, many in whole.items() if usual and sorted(shape) == sorted(usual))
    top = max(seen, key=lambda key: seen[key].boards) if seen else None
    if top is not None and seen[top].boards >= plain and (grid := _of_target(top, seen[top], size)) is not None:
        return grid
    if usual is None and patterns:
        raise FormatError(
            "corners.vnl needs the board's size: no board is complete; give columns and rows (--board 9x6)"
        )
    return None if usual is None else VnlGrid(usual)


def _of_target(key: Key, seen: _Seen, size: Size | None) -> VnlGrid | None:
    """The whole grid of a target as far as it is known: of ChArUco boards from their first corner, of a PuzzleBoard what was seen of it."""
    if key[0] == "charuco":
        first = (0, 0)
        rows = seen.rows.most_common(1)[0][0] if seen.rows else seen.high[1] + 1
        own = int(str(key[2])) - 1, rows
    else:
        first = seen.low[0], seen.low[1]
        own = seen.high[0] - first[0] + 1, seen.high[1] - first[1] + 1
    if size is None or size == own:
        return VnlGrid(own, key, first)
    if size == own[::-1]:
        return VnlGrid(size, key, first, turned=True)
    return VnlGrid(size, key, first) if not seen.rows and size[0] >= own[0] and size[1] >= own[1] else None
