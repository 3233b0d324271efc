"""From corners to boards: link graph, flood fill, completion, validation, ordering. No board size is needed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sized as _Sized
from typing import TypeVar

import numpy as np

from rcdn.boards.alternating import alternating
from rcdn.boards.convert import as_board, as_field
from rcdn.boards.fill import fill
from rcdn.boards.fragments import fragments
from rcdn.boards.graph import Field, cells, label, links
from rcdn.boards.grow import board_sign, grow
from rcdn.boards.local import Grid
from rcdn.boards.merge import merge
from rcdn.boards.overlap import separated
from rcdn.boards.rim import cut_at_rim
from rcdn.boards.side_by_side import apart
from rcdn.boards.validate import believable, distinct, has_rims, is_full, is_striped, plain, prune, skips_lines
from rcdn.corners import Candidates
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import TAGS, Label
from rcdn.types import Array, Board, Warnings, allowed
from rcdn.types.arrays import Bool, Shaped

Sized = TypeVar("Sized", bound=_Sized)
__all__ = ["BOARDS", "count_cells", "find_boards", "find_pieces", "largest"]

CELL = 4
"""corners of the smallest grid"""
PIECES, BOARDS, FILLED = (30, 80), (25, 50), (800, 4000)
"""largest numbers of pieces and of boards that are processed, and of corners of the boards beside which missed corners
are searched for: a minimum, and a number per megapixel (photographs have at most 22 pieces, 12 boards and 400 corners
in a view)"""
GROWN = (80, 160)
"""rounds of growth of all pieces together, likewise (photographs need at most 36 in a view)"""


def find_boards(
    grey: Shaped[Array, "h w"],
    candidates: Candidates,
    least: int = 9,
    scale: float = 1.0,
    warnings: Warnings | None = None,
    tags: bool = False,
) -> list[Board]:
    """Boards among the corners, the one with the most corners first.

    `grey` (H, W): the image in which links are verified; `least`: fewest corners of a board, which also needs four
    complete cells; `scale`: px of `grey` per px of the original image if `grey` is an enlargement (tiny squares are
    trusted less). Returns [] if there is no board. Of many pieces, and of many boards, only the largest are processed,
    which is noted in `warnings`. `tags`: whether lattices of tags, whose steps alternate, count as boards, too.
    """
    field, warnings = as_field(grey, candidates), warnings or Warnings()
    grids = sorted(label(field, cells(field, links(field))), key=lambda g: (-len(g), min(g.values())))
    grids = largest(grids, allowed(grey.size, *PIECES), "pieces of boards", warnings)
    free, boards = np.ones(len(field.xy), bool), []
    lattices = alternating(field, grids, free) if tags else []
    parts, unchanged = _parts(field, grids, free)
    typical = median(candidates.all.response[candidates.sure]) if candidates.sure.any() else 0.0
    whole = set(map(id, parts))
    height, width = grey.shape
    joined = merge(field, [g for g in parts if len(g) >= CELL])
    single = [part for g in joined for one in apart(g) for part in separated(one, (width, height))]
    merged = [g for g in single if len(g) * 2 >= least]
    merged = [g for g in merged if plain(g, field.response, typical)]
    left = allowed(grey.size, *FILLED)
    for grid in largest(merged, allowed(grey.size, *BOARDS), "boards", warnings):
        # A piece that was not merged has been completed before: a second time changes nothing if it is full, or if
        # its last completion changed nothing and no peak has been evaluated since.
        alone, late = id(grid) in whole, field.rounds[0] >= allowed(grey.size, *GROWN)
        if not (alone and (is_full(grid) or unchanged.get(grid) == field.unevaluated)):
            _finish(field, grid, free)
        if believable(grid, least, scale) and plain(grid, field.response, typical):
            sign = board_sign(field, grid)
            if len(grid) <= left:
                fill(field, grid, sign, free)
                left -= len(grid)
            else:
                warnings.add(
                    "fill", f"in boards of {len(grid):,} corners and more none was looked for that the network missed"
                )
            if cut_at_rim(field, grid, sign, free) and not believable(grid, least, scale):
                continue
            sharp = distinct(grid, field.grey) or has_rims(grid, field)
            if sharp and not (skips_lines(grid, field) or is_striped(grid, field)):
                boards.append(as_board(field, candidates, grid))
                if late and not is_full(grid):
                    warnings.add("growth", "boards take too many rounds to complete; some may lack corners")
    boards += [as_board(field, candidates, Grid(at, field.xy), TAGS, 0) for at in lattices]
    return sorted(boards, key=lambda b: (-len(b), *b.xy[0]))


def find_pieces(grey: Array, candidates: Candidates, boards: list[Board]) -> list[Board]:
    """Pieces of boards among the corners outside all `boards`, for code readers (see `fragments`).

    Most of these pieces are not boards at all.
    """
    field = as_field(grey, candidates)
    free = np.ones(len(field.xy), bool)
    if boards:
        free &= nearest(np.concatenate([board.xy for board in boards]), field.xy, 1)[0][:, 0] > 0.5
    grids = fragments(field, free, len(candidates.all))
    return [as_board(field, candidates, Grid(at, field.xy)) for at in grids]


def _parts(field: Field, grids: list[dict[Label, int]], free: Bool[Array, " n"]) -> tuple[list[Grid], dict[Grid, int]]:
    """The grids and the parts that were pruned off them, each pruned and completed.

    Also returns, for each grid that its completion left unchanged, the number of peaks that were waiting then.
    `free` (N,) bool: corners that are in no grid, updated in place.
    """
    parts: list[Grid] = []
    unchanged: dict[Grid, int] = {}
    queue = deque(Grid(at, field.xy) for at in grids)
    while queue:
        grid = queue.popleft()
        grid.at = {spot: corner for spot, corner in grid.at.items() if free[corner]}
        rest = prune(grid, field)
        if len(grid) >= CELL:
            more, as_it_was = _complete(field, grid, free, pruned=not rest)
            rest += more
            parts.append(grid)
            if as_it_was:
                unchanged[grid] = field.unevaluated
        queue += [part for part in rest if CELL <= len(part) < len(grid) + 1]
    return parts, unchanged


def largest(grids: list[Sized], most: int, name: str, warnings: Warnings) -> list[Sized]:
    """The `most` largest grids, in their original order; among grids of equal size the first are kept."""
    if len(grids) <= most:
        return grids
    warnings.add(name, f"of {len(grids):,} {name} only the {most:,} largest were looked at")
    kept = sorted(range(len(grids)), key=lambda k: (-len(grids[k]), k))[:most]
    return [grids[k] for k in sorted(kept)]


def count_cells(grey: Array, candidates: Candidates) -> int:
    """The number of cells that the corners form, from which boards could start."""
    field = as_field(grey, candidates)
    return len(cells(field, links(field)))


def _finish(field: Field, grid: Grid, free: Array) -> None:
    """Complete a merged grid once more, in place. Its corners stay together even where no edge joins its parts."""
    held = dict(grid.at)
    for part in _complete(field, grid, free)[0]:
        again = {spot: corner for spot, corner in part.at.items() if held.get(spot) == corner}
        if len(again) >= CELL:
            grid.at |= again
            free[list(again.values())] = False


def _complete(field: Field, grid: Grid, free: Bool[Array, " n"], pruned: bool = False) -> tuple[list[Grid], bool]:
    """Grow a grid among the corners that are `free` (N,), prune it, and mark its corners as taken, all in place.

    Returns the parts that were pruned off. `pruned`: the last pruning removed nothing, so that pruning is needed only
    if a corner is added. The second value returned is whether this still holds: the grid is unchanged.
    """
    available, before = free.copy(), len(grid)
    available[list(grid.at.values())] = False
    if field.rounds[0] < allowed(field.grey.size, *GROWN):
        grow(field, grid, available)
    as_it_was = pruned and len(grid) == before
    rest = [] if as_it_was else prune(grid, field)
    free[list(grid.at.values())] = False
    return rest, as_it_was
