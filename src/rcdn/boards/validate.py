"""Drop-only validation: a corner that doesn't fit goes; none is ever renamed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.boards.edges import edge_sharpness
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import INNER, REACH, WIDEST, Grid, parts
from rcdn.corners.adaptive import nearest_pitch
from rcdn.types import Array

HOLE = WIDEST
"""squares; a corner is on the rim if nothing follows it within this reach"""
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
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

    Of parts that no edge joins, `grid` keeps the largest; the others are returned as grids of their own, largest first: whether they belong
    to the same board is for `merge` to say.
    """
    while True:
        before = len(grid)
        _drop_misfits(grid)
        _drop_poor_rim(grid, field)
        _drop_loose(grid)
        if len(grid) == before:
            return _split(grid)


def _drop_misfits(grid: Grid) -> None:
    spots = sorted(grid.at)
    excess = dict(zip(spots, predicted_excess(grid, spots).tolist(), strict=True))
    while excess:
        spot = max(excess, key=lambda s: (excess[s], (-s[0], -s[1])))
        if excess[spot] <= 1:
            return
        del grid.at[spot], excess[spot]
        span = range(-REACH - 1, REACH + 2)
        near = [s for d in span for e in span if (s := (spot[0] + d, spot[1] + e)) in excess]
        excess.update(zip(near, predicted_excess(grid, near).tolist(), strict=True))


def _drop_poor_rim(grid: Grid, field: Field) -> None:
    """A corner inside the grid is vouched for by its neighbours; one on the rim must be an X-corner by its own looks."""
    while grid.at:
        spots, corners = list(grid.at), np.array(list(grid.at.values()))
        near = grid.around(spots, HOLE)
        poor = _outermost(near) & (worth(field, corners, near) < LEAST_QUALITY)
        if not poor.any():
            return
        for k in np.flatnonzero(poor).tolist():
            del grid.at[spots[k]]


def _outermost(near: Array) -> Array:
    """(K,) bool from the corners around each, (K, (2 HOLE + 1)²): is there a direction in which there is nothing more (holes don't count)?"""
    there = near.reshape(len(near), 2 * HOLE + 1, 2 * HOLE + 1) >= 0
    row, column = there[:, HOLE], there[:, :, HOLE]
    ways = (row[:, :HOLE], row[:, HOLE + 1 :], column[:, :HOLE], column[:, HOLE + 1 :])
    return ~np.logical_and.reduce([way.any(axis=1) for way in ways])


def worth(field: Field, corners: Array, near: Array) -> Array:
    """Response × fit of a grid's `corners` (K,) against their median, times their contrast against that of those `near` (K, (2 HOLE + 1)²)."""
    quality = field.response[corners] * field.fit[corners]
    near = near[:, INNER]
    near[:, len(INNER) // 2] = -1
    usual = row_median(field.contrast[near], near >= 0)
    share = np.where(np.isnan(usual), 1.0, field.contrast[corners] / np.maximum(np.nan_to_num(usual), 1e-9))
    return np.asarray(quality / max(float(np.median(quality)), 1e-9) * np.clip(share, LEAST_SHARE, 1))


def row_median(values: Array, there: Array) -> Array:
    """Medians (K,) of those of `values` (K, N) that are `there`; NaN where none is."""
    ranked = np.sort(np.where(there, values, np.inf), axis=1)
    count = there.sum(axis=1)
    row, low = np.arange(len(ranked)), np.maximum(count - 1, 0) // 2
    middle = (ranked[row, low] + ranked[row, np.minimum(count // 2, ranked.shape[1] - 1)]) / 2
    return np.where(count > 0, middle, np.nan)


def predicted_excess(grid: Grid, spots: Sequence[Label]) -> Array:
    """Distances (K,) of labelled corners from where their neighbours predict them ÷ what is allowed; 2 where they can't."""
    if not len(spots):
        return np.zeros(0)
    near = grid.around(spots, WIDEST)
    guess = grid.predictions(spots, near)
    limit = np.where(_between(near), RESIDUAL, RESIDUAL_LOOSE)
    off = np.linalg.norm(grid.xy[[grid.at[spot] for spot in spots]] - guess.xy, axis=1)
    return np.where(guess.support > 0, off / (limit * np.maximum(guess.pitch, 1e-9)), 2.0)


def inner(grid: Grid, spots: Sequence[Label]) -> Array:
    """(K,) bool: neighbours on both sides, along at least one of the two directions."""
    return _between(grid.around(spots, 1))


def _between(near: Array) -> Array:
    """`inner` from the corners in windows around the labels (K, side²)."""
    there, middle, side = near >= 0, near.shape[1] // 2, int(np.sqrt(near.shape[1]))
    one, other = (there[:, middle - step] & there[:, middle + step] for step in (1, side))
    return np.asarray(one | other)


def _drop_loose(grid: Grid) -> None:
    """Every corner belongs to a whole cell."""
    while True:
        cells = {(u, v) for u, v in grid.at if all(s in grid.at for s in ((u + 1, v), (u, v + 1), (u + 1, v + 1)))}
        held = {(u + d, v + e) for u, v in cells for d in (0, 1) for e in (0, 1)}
        loose = set(grid.at) - held
        if not loose:
            return
        for spot in loose:
            del grid.at[spot]


def _split(grid: Grid) -> list[Grid]:
    """Leave the largest of the parts that edges join; return the others."""
    rest = parts(grid.at, STEPS)[1:]
    others = [Grid({spot: grid.at[spot] for spot in sorted(part)}, grid.xy) for part in rest]
    for part in rest:
        for spot in part:
            del grid.at[spot]
    return others


SMALL = ((5.6, 1.0), (7.0, 0.9))
"""(pitch px, share of its box that a board of smaller squares must fill)"""
SMALL_LEAST = 20
"""corners of a board of such squares"""


def believable(grid: Grid, least: int, scale: float = 1.0) -> bool:
    """Is it a board? At least `least` corners and four whole cells. `scale`: px of the grid for one of the picture.

    Where squares are under 7 px of the picture, keyboards and grilles look just like boards: there it takes 20 corners that fill nearly
    all of their box, under 5.6 px all of it.
    """
    if len(grid) < least or cell_count(grid) < 4:
        return False
    spots, xy = np.array(list(grid.at)), grid.xy[list(grid.at.values())]
    pitch = float(np.median(nearest_pitch(xy))) / scale
    fill = len(spots) / float(np.prod(np.ptp(spots, axis=0) + 1))
    needed = next((share for limit, share in SMALL if pitch < limit), 0.0)
    return fill >= needed and (len(spots) >= SMALL_LEAST or not needed)


FAINT = 0.65
"""least median response of a board, share of the picture's usual one: folds and slats near a real board have under 0.5"""
FEW, FEW_FAINT = 16, 0.6
"""a board of fewer corners needs this median response whatever is usual: staggered tiles have saddles with 0.55"""


def plain(grid: Grid, response: Array, usual: float) -> bool:
    """Are the board's corners plainly corners, by their `response` (N,), where `usual` is the median of all sure ones?"""
    median = float(np.median(response[list(grid.at.values())]))
    return median >= FAINT * usual and (len(grid) >= FEW or median >= FEW_FAINT)


SOFT, SOFT_LEAST, SOFT_FILL = 0.5, 20, 0.8
"""sharpness of its edges under which a board must have so many corners and fill so much of its box"""


def distinct(grid: Grid, grey: Array) -> bool:
    """Has the board sharp edges, or enough corners to be told from folds and tartans, which wave like a blurred board?"""
    links = [(at, to) for at in grid.at for d, e in STEPS[:2] if (to := (at[0] + d, at[1] + e)) in grid.at]
    start, end = (grid.xy[[grid.at[link[k]] for link in links]] for k in (0, 1))
    if edge_sharpness(grey, start, end) >= SOFT:
        return True
    return len(grid) >= SOFT_LEAST and len(grid) >= SOFT_FILL * float(np.prod(np.ptp(list(grid.at), axis=0) + 1))


def is_full(grid: Grid) -> bool:
    """Has every label of the bounding grid its corner?"""
    return len(grid) == int(np.prod(np.ptp(list(grid.at), axis=0) + 1))


def cell_count(grid: Grid) -> int:
    """Whole cells of a grid."""
    return sum(all(s in grid.at for s in ((u + 1, v), (u, v + 1), (u + 1, v + 1))) for u, v in grid.at)
