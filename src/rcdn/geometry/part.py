"""Where the visible part of a plain board of squares lies on the whole board."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rcdn.geometry.cut import open_ends
from rcdn.geometry.order import colour_after, rightward, turn_labels
from rcdn.geometry.rules import CHECKER
from rcdn.types import Array, Board
from rcdn.types.arrays import Int

Size = tuple[int, int]


def common_colour(boards: Iterable[Board], size: Size | None) -> bool | None:
    """Whether the square inside (0, 0) of the whole board of `size` (columns, rows) is dark, from those of `boards`
    that show it whole; None if they do not tell, or disagree. On a square board with an odd number of corners a side
    it always is: a quarter turn exchanges the colours, and `labels_of` turns the boards on which it is bright."""
    if size is None or CHECKER.orientation(*size) == "unique":
        return None if size is None else True
    odd = size[0] % 2 == size[1] % 2 == 1  # a quarter turn exchanges the colours
    found = {
        b.origin_dark != (odd and b.size != size)
        for b in boards
        if b.origin_dark is not None and b.size in (size, size[::-1])
    }
    if odd and size[0] == size[1]:
        return True if found else None
    return found.pop() if len(found) == 1 else None


def tells_its_way(board: Board, size: Size) -> bool:
    """Whether the colours of a plain `board`, a part of one of `size` (columns, rows), tell it from one turned by
    half."""
    return board.origin_dark is not None and CHECKER.orientation(*size) == "unique"


def labels_of(board: Board, size: Size, dark: bool | None) -> Int[Array, "m 2"] | None:
    """(M, 2) labels of the corners of a plain `board` on the whole board of `size` (columns, rows); None if its place
    is unknown.

    A board whose bounding box has that size, holes included, is the whole one; one of the transposed size is rotated by
    the quarter turn of `Board.grid_of`, as is a square one of the other colours. A smaller one is placed if the
    picture's border cut it so that it has one place only. `dark`: whether the square inside the whole board's (0, 0) is
    dark (`common_colour`); None if unknown: then no part is placed.
    """
    if not len(board):
        return None
    own = np.asarray(board.ij - board.ij.min(axis=0))
    if board.size == size and not of_other_colours(board, dark):
        return own
    if board.pattern != "checker":  # a deltille has no end that could be seen, and no quarter turns
        return None
    if board.size in (size, size[::-1]):
        return np.asarray(turn_labels(own, board.size, quarter_turns(board.size)))
    return None if board.target is not None else _place_of(board, size, dark)


def of_other_colours(board: Board, dark: bool | None) -> bool:
    """Whether a plain `board` is a square one that a quarter turn brings to the colours `dark`."""
    columns, rows = board.size
    known = dark is not None and board.origin_dark is not None and board.target is None
    return columns == rows and columns % 2 == 1 and known and board.origin_dark != dark


def _place_of(board: Board, size: Size, dark: bool | None) -> Int[Array, "m 2"] | None:
    """(M, 2) labels of a part's corners on the whole board of `size` (columns, rows), if the picture's border explains
    what is missing in one way only; None otherwise.

    In each direction in which the part is smaller, one end must lie at the border and the other one end within the
    picture (`open_ends`). The colours tell which half turn is right; of a board that looks the same after half a turn
    they must agree, and it is placed as it lies, as whole boards are labelled.
    """
    if dark is None or board.origin_dark is None:
        return None
    ends = open_ends(board.ij, board.xy, board.image_size)
    if ends is None:
        return None
    found: dict[int, Array] = {}
    for turn in range(4):
        ij = CHECKER.started(CHECKER.turned(board.ij, turn))
        if turn:  # takes (i, j) to (−j, i)
            ends = np.stack([ends[1, ::-1], ends[0]])
        missing = np.array(size) - 1 - ij.max(axis=0)
        if (missing < 0).any():
            continue
        if (ends.all(axis=1) & (missing > 0)).any():
            return None
        if (ends.any(axis=1) | (missing == 0)).all():
            placed = ij + np.where(ends[:, 0], missing, 0)
            if _same_colours(board, turn, placed, dark):
                found[turn] = placed
    halves = size[0] == size[1] or len({turn % 2 for turn in found}) == 1
    if not found or not halves or (len(found) > 1 and CHECKER.orientation(*size) == "unique"):
        return None
    return max(found.values(), key=lambda ij: _as_it_lies(ij, board.xy, size))


def _as_it_lies(ij: Array, xy: Array, size: Size) -> float:
    """Cosine of the angle between +x and the i axis, of labels `ij` on a board of `size` or, where they run vertically,
    of those from which a whole board would be turned by a quarter."""
    level = rightward(ij, xy)
    return level if abs(level) >= np.sqrt(0.5) else rightward(turn_labels(ij, size, -quarter_turns(size[::-1])), xy)


def quarter_turns(size: Size) -> int:
    """The quarter turns by which a board of `size` is turned to the transposed size, as by `Board.grid_of`."""
    return 1 if size[0] % 2 == 0 else 3


def _same_colours(board: Board, turn: int, placed: Array, dark: bool) -> bool:
    """Whether the colours of a part, with labels `placed` after `turn` turns, are those of the whole board."""
    colour = colour_after(board.ij - board.ij.min(axis=0), -1 if board.origin_dark else 1, turn)
    return (colour < 0) == (dark ^ bool(placed.min(axis=0).sum() % 2))
