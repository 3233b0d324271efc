"""The rim of a board: one or two corners beyond it are no column or row if the image shows that the board ends beside
them."""

from __future__ import annotations

import numpy as np

from rcdn.boards.edges import edge_contrast
from rcdn.boards.fill import SEEN, Spots, with_sense
from rcdn.boards.graph import Field
from rcdn.boards.grow import SHOWN, SHOWN_WEAK
from rcdn.boards.local import Grid, windows
from rcdn.boards.validate import is_full
from rcdn.geometry.rules import CHECKER
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

FEW = 2
"""largest number of corners that do not establish a column by themselves: where a dark background meets a white margin,
as many corners appear as beside a square"""
LEAST_ENDS = 2
"""fewest spots of a column at which the board must be seen to end before it"""
CLEAR = 0.4
"""distance to the image border, squares, within which a crossing may be invisible"""


def cut_at_rim(field: Field, grid: Grid, sign: int, free: Bool[Array, " n"]) -> bool:
    """Remove outermost columns and rows of one or two corners if the board is seen to end at as many of their other
    spots, and at two at least.

    In place; `free` (N,) bool: corners that are in no board, updated. `sign`: the board's colouring
    (`grow.board_sign`); 0 changes nothing. Returns whether a corner was removed. Columns cut by the image border or an
    occluder are kept: there the edges that lead to the hidden corners are hidden, too.
    """
    before = len(grid)
    while (
        sign
        and not is_full(grid)
        and any([_cut_side(field, grid, sign, free, np.array(step)) for step in CHECKER.steps])
    ):
        pass
    return len(grid) < before


def _cut_side(field: Field, grid: Grid, sign: int, free: Array, inward: Int[Array, " 2"]) -> bool:
    """Remove the outermost line of corners, on the side from which the step `inward` (2,) leads into the grid, if the
    board ends before it."""
    labels = grid.labels
    depth = labels @ inward
    line = labels[depth == depth.min()]
    if not 0 < len(line) <= FEW:
        return False
    spots = labels[depth == depth.min() + 1] - inward
    spots = spots[windows(labels, spots, 0)[:, 0] < 0]
    if _ends(field, grid, sign, spots, inward).sum() < max(len(line), LEAST_ENDS):
        return False
    for u, v in line.tolist():
        corner = grid.at.pop((u, v))
        if corner < len(free):
            free[corner] = True
    return True


def _ends(field: Field, grid: Grid, sign: int, spots: Int[Array, "k 2"], inward: Array) -> Array:
    """Evidence, 0, ½ or 1, that the board ends at each of the empty `spots` (K, 2), which are one step outside a corner
    each.

    Evidence means that the edge from the corner to the spot is visible, with about the contrast of the edge on the
    corner's other side, but no crossing at its end. It counts half where the edge cannot be followed to its end, due to
    noise or since an occluder or a dark region begins there.
    """
    near, behind = _Known(grid, spots + inward), _Known(grid, spots + 2 * inward)
    guess, inner = grid.predictions(spots), grid.predictions(spots + inward)
    some = np.intersect1d(with_sense(guess), with_sense(inner))
    some = some[near.has[some] & behind.has[some] & _clear(field.grey, guess.maps[some])]
    start, end = near.xy[some], guess.xy[some]
    # the sides of an edge exchange their colours at each corner
    typical = -np.median(edge_contrast(field.grey, behind.xy[some], start), axis=1)
    whole, far = (_share(edge_contrast(field.grey, at, end), typical) for at in (start, 0.5 * (start + end)))
    shown = np.where(whole >= SHOWN_WEAK, np.where(far >= SHOWN, 1.0, 0.5), 0.0)
    here = Spots(spots[some], guess.take(some)).crossings(field.grey, sign)[1]
    there = Spots(spots[some] + inward, inner.take(some)).crossings(field.grey, sign)[1]
    crossed = ((here >= SEEN * there) | (there <= 0)).all(axis=1)
    return np.where(crossed, 0.0, shown)


def _share(contrast: Real[Array, "k 3"], typical: Real[Array, " k"]) -> Array:
    """The smallest of the thirds of `contrast` (K, 3), as a share of the `typical` contrast (K,)."""
    return (contrast / np.where(typical == 0, np.inf, typical)[:, None]).min(axis=1)


class _Known:
    """Which `spots` (K, 2) of a grid have corners, `has` (K,), and the positions of these, `xy` (K, 2) px."""

    def __init__(self, grid: Grid, spots: Array) -> None:
        rows = windows(grid.labels, spots, 0)[:, 0]
        self.has, self.xy = rows >= 0, grid.xy[grid.corners[rows]]


def _clear(grey: Array, maps: Real[Array, "k 6"]) -> Bool[Array, " k"]:
    """Which predicted corners (K,), with `maps` (K, 6) as in `Predictions`, lie far enough from the image border."""
    height, width = grey.shape
    reach = CLEAR * np.maximum(np.abs(maps[:, 2:4]), np.abs(maps[:, 4:]))
    xy = maps[:, :2]
    return np.asarray(((xy >= reach) & (xy <= np.array([width - 1, height - 1]) - reach)).all(axis=1))
