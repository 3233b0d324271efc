"""Drop-only validation: a corner that doesn't fit goes; none is ever renamed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.boards.edges import edge_sharpness
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid, windows
from rcdn.corners.adaptive import nearest_pitch
from rcdn.geometry.median import median
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

_prune = bind("rcdn_grid_prune")
_excess = bind("rcdn_grid_excess")
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""to a corner's neighbours"""
RESIDUAL = 0.15
"""largest distance from the neighbours' prediction, share of the pitch"""
RESIDUAL_LOOSE = 0.18
"""the same where the prediction extrapolates from few corners"""


LEAST_QUALITY = 0.3
"""least worth of a corner on the grid's rim: T-junctions along a board's outer edge have 0.1–0.26, true corners 0.45 and more"""
LEAST_SHARE = 0.45
"""a contrast under this share of the neighbours' counts as this much: shadows do that to true corners, too"""


def prune(grid: Grid, field: Field) -> list[Grid]:
    """Drop misfits, worst first, then rim corners that are hardly X-corners, then what is in no whole cell, until nothing changes. In place.

    A misfit lies off its neighbours' prediction, or they predict nothing. A corner inside the grid is vouched for by its neighbours; one beyond
    which nothing follows within three squares must be an X-corner by its own looks: response × fit against their median, times its contrast
    against that of its neighbours.

    Of parts that no edge joins, `grid` keeps the largest; the others are returned as grids of their own, largest first: whether they belong
    to the same board is for `merge` to say.
    """
    labels, corners = grid.labels, grid.corners
    part = np.empty(len(labels), np.int64)
    quality, contrast = field.response[corners] * field.fit[corners], field.contrast[corners]
    limits = RESIDUAL, RESIDUAL_LOOSE, LEAST_QUALITY, LEAST_SHARE
    count = _prune(labels, grid.xy[corners], quality, contrast, *limits, part)
    if count == 1 and part.max() == part.min():
        return []
    members = list(zip(part.tolist(), grid.at.items(), strict=True))
    grid.at = {spot: corner for number, (spot, corner) in members if number == 0}
    rest: list[dict[Label, int]] = [{} for _ in range(count - 1)]
    for number, (spot, corner) in members:
        if number > 0:
            rest[number - 1][spot] = corner
    return [Grid(dict(sorted(at.items())), grid.xy) for at in rest]


def predicted_excess(grid: Grid, spots: Sequence[Label]) -> Shaped[Array, " k"]:
    """Distances (K,) of labelled corners from where their neighbours predict them ÷ what is allowed; 2 where they can't."""
    labels = grid.labels
    rows = {spot: row for row, spot in enumerate(grid.at)}
    which, out = np.array([rows[spot] for spot in spots], np.int64), np.empty(len(spots))
    _excess(labels, grid.xy[grid.corners], which, RESIDUAL, RESIDUAL_LOOSE, out)
    return out


SMALL = ((5.6, 1.0), (7.0, 0.9))
"""(pitch px, share of its box that a board of smaller squares must fill)"""
SMALL_LEAST = 20
"""corners of a board of such squares"""
LARGE, LARGE_FILL = 1000, 0.9
"""a board of so many corners must fill this share of its box, however small its squares: no keyboard has as many"""


def believable(grid: Grid, least: int, scale: float = 1.0) -> bool:
    """Is it a board? At least `least` corners and four whole cells. `scale`: px of the grid for one of the picture.

    Where squares are under 7 px of the picture, keyboards and grilles look just like boards: there it takes 20 corners that fill nearly
    all of their box, under 5.6 px all of it, unless they are a thousand.
    """
    if len(grid) < least or cell_count(grid) < 4:
        return False
    spots, xy = grid.labels, grid.xy[grid.corners]
    pitch = median(nearest_pitch(xy)) / scale
    fill = len(spots) / float(np.prod(np.ptp(spots, axis=0) + 1))
    needed = next((share for limit, share in SMALL if pitch < limit), 0.0)
    needed = min(needed, LARGE_FILL) if len(spots) >= LARGE else needed
    return fill >= needed and (len(spots) >= SMALL_LEAST or not needed)


FAINT = 0.65
"""least median response of a board, share of the picture's usual one: folds and slats near a real board have under 0.5"""
FEW, FEW_FAINT = 16, 0.6
"""a board of fewer corners needs this median response whatever is usual: staggered tiles have saddles with 0.55"""


def plain(grid: Grid, response: Real[Array, " n"], usual: float) -> bool:
    """Are the board's corners plainly corners, by their `response` (N,), where `usual` is the median of all sure ones?"""
    own = median(response[grid.corners])
    return own >= FAINT * usual and (len(grid) >= FEW or own >= FEW_FAINT)


SOFT, SOFT_LEAST, SOFT_FILL = 0.5, 20, 0.8
"""sharpness of its edges under which a board must have so many corners and fill so much of its box"""


def distinct(grid: Grid, grey: Array) -> bool:
    """Has the board sharp edges, or enough corners to be told from folds and tartans, which wave like a blurred board?"""
    labels, xy = grid.labels, grid.xy[grid.corners]
    following = ahead(labels)[:, :2]
    row, way = np.nonzero(following >= 0)
    if edge_sharpness(grey, xy[row], xy[following[row, way]]) >= SOFT:
        return True
    return len(grid) >= SOFT_LEAST and len(grid) >= SOFT_FILL * float(np.prod(np.ptp(labels, axis=0) + 1))


def is_full(grid: Grid) -> bool:
    """Has every label of the bounding grid its corner?"""
    return len(grid) == int(np.prod(np.ptp(grid.labels, axis=0) + 1))


def cell_count(grid: Grid) -> int:
    """Whole cells of a grid."""
    return int((ahead(grid.labels) >= 0).all(axis=1).sum())


def ahead(labels: Int[Array, "m 2"]) -> Int[Array, "m 3"]:
    """Rows (M, 3) of the next of `labels` (M, 2) along u, along v, and along both; −1 for none."""
    return windows(labels, labels, 1)[:, (5, 7, 8)]
