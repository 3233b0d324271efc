"""Where the visible part of a plain board of squares lies on the whole board."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rcdn.geometry.cut import open_ends
from rcdn.geometry.order import colour_after, rightward, turn_labels
from rcdn.geometry.rules import CHECKER
from rcdn.types import Array, Board
from rcdn.types.arrays import Int, Real

Size = tuple[int, int]


def origin_dark(colours: Iterable[bool | None], size: Size | None) -> bool | None:
    """Whether the square inside (0, 0) of whole boards of `size` is dark, from `Board.origin_dark` of those that were
    seen; None if that is unknown, or not the same in all of them."""
    if size is not None and CHECKER.orientation(*size) == "unique":
        return True
    found = set(colours)
    return found.pop() if len(found) == 1 else None


def labels_of(board: Board, size: Size, dark: bool | None) -> Int[Array, "m 2"] | None:
    """(M, 2) labels of the corners of a plain `board` on the whole board of `size` (columns, rows); None if its place
    is unknown.

    A board whose bounding box has that size, holes included, is the whole one; one of the transposed size is rotated by
    the quarter turn that keeps the colour of the square inside (0, 0), as in `Board.grid_of`. A smaller one is placed
    if the picture's border cut it so that it has one place only. `dark`: whether the square inside the whole board's
    (0, 0) is dark, None if unknown (`origin_dark`).
    """
    if not len(board):
        return None
    if board.size == size:
        return np.asarray(board.ij - board.ij.min(axis=0))
    if board.pattern != "checker":  # a deltille has no end that could be seen, and no quarter turns
        return None
    if board.size == size[::-1]:
        own = board.ij - board.ij.min(axis=0)
        return turn_labels(own, board.size, 1 if board.size[0] % 2 == 0 else 3)
    return None if board.target is not None else _place_of(board, size, dark)


def grid_on(board: Board, size: Size, dark: bool | None) -> Real[Array, "r c 2"] | None:
    """Positions of a plain board's corners on the whole board of `size` (columns, rows), px, NaN where they were not
    found; None if its place is unknown. `dark` as in `labels_of`."""
    ij = labels_of(board, size, dark)
    if ij is None:
        return None
    out = np.full((size[1], size[0], 2), np.nan)
    out[ij[:, 1], ij[:, 0]] = board.xy
    return out


def _place_of(board: Board, size: Size, dark: bool | None) -> Int[Array, "m 2"] | None:
    """(M, 2) labels of a part's corners on the whole board of `size` (columns, rows), if the picture's border explains
    what is missing in one way only; None otherwise.

    `dark`: whether the square inside the whole board's (0, 0) is dark, None if unknown. In each direction in which the
    part is smaller, one end must lie at the border and the other one end within the picture (`open_ends`). The colours
    tell which half turn is right, or how the board lies if it looks the same after half a turn.
    """
    found: dict[int, Array] = {}
    for turn in range(4):
        ij = CHECKER.started(CHECKER.turned(board.ij, turn))
        missing = np.array(size) - 1 - ij.max(axis=0)
        if (missing < 0).any():
            continue
        ends = open_ends(ij, board.xy, board.image_size)
        if ends is None or (ends.all(axis=1) & (missing > 0)).any():
            return None
        if (ends.any(axis=1) | (missing == 0)).all():
            placed = ij + np.where(ends[:, 0], missing, 0)
            if _same_colours(board, turn, placed, dark):
                found[turn] = placed
    halves = size[0] == size[1] or len({turn % 2 for turn in found}) == 1
    if not found or not halves or (len(found) > 1 and CHECKER.orientation(*size) == "unique"):
        return None
    return max(found.values(), key=lambda ij: rightward(ij, board.xy))


def _same_colours(board: Board, turn: int, placed: Array, dark: bool | None) -> bool:
    """Whether the colours of a part, with labels `placed` after `turn` turns, may be those of the whole board."""
    if dark is None or board.origin_dark is None:
        return True
    colour = colour_after(board.ij - board.ij.min(axis=0), -1 if board.origin_dark else 1, turn)
    return (colour < 0) == (dark ^ bool(placed.min(axis=0).sum() % 2))
