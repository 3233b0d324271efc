"""The single grid of a corners.vnl, and the positions of each board's corners in it.

Boards with decoded codes have a known position on the target, so that each visible part is written there. Other boards
are written only if their size is that of the grid.
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
    """A grid of `size` (columns, rows). If `key` is None, it is for whole boards; else for boards of that target, with
    the target's corner `first` (i, j) as its first corner before the grid is `turned` by a quarter turn, if it is."""

    size: Size
    key: Key | None = None
    first: Size = (0, 0)
    turned: bool = False

    def positions(self, board: Board) -> Array | None:
        """The board's corners on this grid (rows, columns, 2), NaN for missing ones; None if the board doesn't
        match."""
        if self.key is None:
            return board.grid_of(self.size) if board.pattern == "checker" else None
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
    """Statistics of one target: the number of `boards`, their lowest (`low`) and highest (`high`) labels, and how often
    each number of `rows` of corners occurred."""

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
    """A key equal for boards of the same target with a uniform grid; None for a board without a position on such a
    target."""
    target = board.target
    if target is None or isinstance(target, AprilGrid):
        return None
    if isinstance(target, Charuco):
        family = re.sub("_[0-9]+$", "", target.dictionary)  # a part of a board may be read with a smaller dictionary
        return target.kind, family, target.columns, target.first_id, target.legacy, target.inverted
    return (target.kind,)


def grid_for(pictures: Iterable[Iterable[Board]], size: Size | None) -> VnlGrid | None:
    """The grid of the majority of the boards in `pictures`; `size` (columns, rows): its required size, or None. Returns
    None if there are no boards.

    Raises FormatError if the grid can't be determined.
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

    common = usual_size(plain_boards())
    if patterns == {"aprilgrid"}:
        raise FormatError("corners.vnl is for grids of even steps, and those of an AprilGrid aren't even; write JSON")
    common = size or common
    plain = sum(many for shape, many in whole.items() if common and sorted(shape) == sorted(common))
    top = max(seen, key=lambda key: seen[key].boards) if seen else None
    if top is not None and seen[top].boards >= plain and (grid := _of_target(top, seen[top], size)) is not None:
        return grid
    if common is None and patterns:
        raise FormatError(
            "corners.vnl needs the board's size: no board is complete; give columns and rows (--board 9x6)"
        )
    return None if common is None else VnlGrid(common)


def _of_target(key: Key, seen: _Seen, size: Size | None) -> VnlGrid | None:
    """The grid of a target, as far as it is known: of ChArUco boards from their first corner, of a PuzzleBoard the
    visible part; None if it contradicts `size`."""
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
