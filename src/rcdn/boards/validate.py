"""Drop-only validation: a corner that doesn't fit goes; none is ever renamed."""

from __future__ import annotations

import numpy as np

from rcdn.boards.edges import edge_sharpness
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import REACH, Grid
from rcdn.corners.adaptive import nearest_pitch
from rcdn.types import Array

HOLE = 3
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
    excess = {spot: predicted_excess(grid, spot) for spot in sorted(grid.at)}
    while excess:
        spot = max(excess, key=lambda s: (excess[s], (-s[0], -s[1])))
        if excess[spot] <= 1:
            return
        del grid.at[spot], excess[spot]
        for d in range(-REACH - 1, REACH + 2):
            for e in range(-REACH - 1, REACH + 2):
                near = (spot[0] + d, spot[1] + e)
                if near in excess:
                    excess[near] = predicted_excess(grid, near)


def _drop_poor_rim(grid: Grid, field: Field) -> None:
    """A corner inside the grid is vouched for by its neighbours; one on the rim must be an X-corner by its own looks."""
    while grid.at:
        median = float(np.median(field.quality[list(grid.at.values())]))
        rim = [spot for spot in grid.at if _outermost(grid, spot)]
        poor = [spot for spot in rim if worth(grid, field, spot, median) < LEAST_QUALITY]
        if not poor:
            return
        for spot in poor:
            del grid.at[spot]


def _outermost(grid: Grid, spot: Label) -> bool:
    """Is there a direction in which the grid has nothing more (holes don't count)?"""
    u, v = spot
    return not all(any((u + k * d, v + k * e) in grid.at for k in range(1, HOLE + 1)) for d, e in STEPS)


def worth(grid: Grid, field: Field, spot: Label, median: float) -> float:
    """Response × fit of a corner against the grid's `median`, times its contrast against that of its neighbours in the grid."""
    corner = grid.at[spot]
    near = grid.neighbours(spot)
    share = field.contrast[corner] / max(float(np.median(field.contrast[near])), 1e-9) if near else 1.0
    return float(field.quality[corner] / max(median, 1e-9) * np.clip(share, LEAST_SHARE, 1))


def predicted_excess(grid: Grid, spot: Label) -> float:
    """Distance of a labelled corner from where its neighbours predict it ÷ what is allowed; 2 where they can't."""
    guess = grid.predict(spot)
    if guess is None:
        return 2.0
    limit = RESIDUAL if inner(grid, spot) else RESIDUAL_LOOSE
    return float(np.linalg.norm(grid.xy[grid.at[spot]] - guess.xy)) / (limit * max(guess.pitch, 1e-9))


def inner(grid: Grid, spot: Label) -> bool:
    """Neighbours on both sides, along at least one of the two directions."""
    u, v = spot
    return any((u - d, v - e) in grid.at and (u + d, v + e) in grid.at for d, e in ((1, 0), (0, 1)))


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
    left, parts = set(grid.at), []
    while left:
        stack, part = [min(left)], set()
        while stack:
            u, v = stack.pop()
            if (u, v) not in left:
                continue
            left.discard((u, v))
            part.add((u, v))
            stack += [(u + d, v + e) for d, e in STEPS]
        parts.append(part)
    parts.sort(key=lambda p: (-len(p), min(p)))
    others = [Grid({spot: grid.at[spot] for spot in sorted(part)}, grid.xy) for part in parts[1:]]
    for part in parts[1:]:
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


def cell_count(grid: Grid) -> int:
    """Whole cells of a grid."""
    return sum(all(s in grid.at for s in ((u + 1, v), (u, v + 1), (u + 1, v + 1))) for u, v in grid.at)
