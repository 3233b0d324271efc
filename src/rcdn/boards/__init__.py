"""From corners to boards: link graph, flood fill, completion, validation, ordering. No board size is needed."""

from __future__ import annotations

import numpy as np

from rcdn.boards.graph import Field, cells, label, links
from rcdn.boards.grow import board_sign, grow
from rcdn.boards.local import Grid
from rcdn.boards.merge import merge
from rcdn.boards.order import ordered, orientation
from rcdn.boards.validate import believable, prune
from rcdn.corners import Candidates
from rcdn.types import Array, Board, Status

__all__ = ["find_boards"]

CELL = 4
"""corners of the smallest grid"""


def find_boards(grey: Array, candidates: Candidates, least: int = 9) -> list[Board]:
    """Boards among corners, the one with most corners first.

    `grey` (H, W), in which links are checked; `least`: fewest corners of a board, which also needs four whole cells. No board gives [].
    """
    field = _field(grey, candidates)
    grids = sorted(label(field, cells(field, links(field))), key=lambda g: (-len(g), min(g.values())))
    free, parts = np.ones(len(field.xy), bool), []
    queue = [Grid(at, field.xy) for at in grids]
    while queue:
        grid = queue.pop(0)
        grid.at = {spot: corner for spot, corner in grid.at.items() if free[corner]}
        rest = prune(grid, field)
        if len(grid) >= CELL:
            rest += _complete(field, grid, free)
            parts.append(grid)
        queue += [part for part in rest if CELL <= len(part) < len(grid) + 1]
    boards = []
    for grid in merge(field, [g for g in parts if len(g) >= CELL]):
        for part in _complete(
            field, grid, free
        ):  # of a merged grid, parts that no edge joins belong together all the same
            if len(part) >= CELL:
                grid.at |= part.at
                free[list(part.at.values())] = False
        if believable(grid, least):
            boards.append(_board(field, candidates, grid))
    return sorted(boards, key=lambda b: (-len(b), *b.xy[0]))


def _complete(field: Field, grid: Grid, free: Array) -> list[Grid]:
    """Grow a grid among the corners that are `free` (N,), prune it, and take what it holds. In place; returns what fell off."""
    available = free.copy()
    available[list(grid.at.values())] = False
    grow(field, grid, available)
    rest = prune(grid, field)
    free[list(grid.at.values())] = False
    return rest


def _field(grey: Array, candidates: Candidates) -> Field:
    found, seen = candidates.all, candidates.orientation
    refined = found.status != Status.SEED
    return Field(
        grey,
        found.xy,
        seen.axes,
        seen.polarity.astype(int),
        seen.contrast,
        seen.fit,
        found.response,
        candidates.seed,
        refined,
    )


def _board(field: Field, candidates: Candidates, grid: Grid) -> Board:
    ij = np.array(list(grid.at))
    index = np.array(list(grid.at.values()))
    # side colour of u at (0, 0) is the colour of the square towards +v, which lies between (0, 0) and (1, 1)
    sign = board_sign(field, grid)
    new = ordered(ij, field.xy[index], sign)
    order = np.lexsort((new[:, 0], new[:, 1]))
    index, new = index[order], new[order]
    cols, rows = new.max(axis=0) + 1
    found = candidates.all.take(index)
    below = ~candidates.sure[index] & (found.status == Status.REFINED)
    status = np.where(below, Status.COMPLETED, found.status)
    height, width = field.grey.shape
    turn = orientation(int(cols), int(rows)) if sign else "ambiguous_180"  # without colours nothing is settled
    return Board(found.xy, new, (width, height), found.response, status, turn, found.sigma)
