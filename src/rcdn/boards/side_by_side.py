"""Separates boards that stand side by side with less than a square of paper between them and look like one lattice.

Where the squares of both alternate across the gap, its middle looks like a line of corners. But the steps to it, from
both sides, are longer than those beyond, by half of the gap; in one board they change gradually.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.boards.local import Grid, windows
from rcdn.geometry.median import medians
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

LONGER = 0.04
"""least excess of the steps to a line over what those beyond it let expect (logarithm of the ratio), median over the
line"""
CHANGE = 2.0
"""largest change between the two steps beyond, in excesses"""
AGREE = 0.8
"""least share of the corners of the line with half of that excess"""
BOTH = 0.5
"""least excess of each of the two steps, in mean excesses of both"""
EVEN = 0.02
"""largest distance of the steps of a board, as logarithms, from a polynomial of degree two"""
FEWEST = 4
"""fewest corners of the line with `REACH` neighbours on either side, and fewest steps of a board that say whether they
are even"""
REACH = 3
"""steps on either side of a corner that are compared"""


def apart(grid: Grid) -> list[Grid]:
    """The grid, or the boards that it consists of, without the lines of false corners between them."""
    labels, xy = grid.labels, grid.xy[grid.corners]
    for axis in (0, 1):
        along = labels[:, axis]
        if np.ptp(along) < 2 * REACH:
            continue
        lines = _between(along, _excess(labels, xy, axis))
        side = np.where(np.isin(along, lines), -1, np.searchsorted(lines, along))
        pieces = [np.flatnonzero(side == k) for k in range(len(lines) + 1)] if len(lines) else []
        pieces = [some for some in pieces if len(some)]
        if len(pieces) > 1 and _even([(labels[some], xy[some]) for some in pieces], axis):
            items = list(grid.at.items())
            return [g for some in pieces for g in apart(Grid(dict(items[k] for k in some), grid.xy))]
    return [grid]


def _excess(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], axis: int) -> Real[Array, "m 4"]:
    """Of the logarithms of the steps along `axis` to a corner, (M, 4): by how much both exceed in the mean what the two
    steps beyond let expect (an even polynomial of degree two, so that neither perspective nor a lens counts); by how
    much each exceeds the line through the two beyond it on its side; and the larger change between those two. NaN where
    a neighbour is missing."""
    side, step = 2 * REACH + 1, (1, 2 * REACH + 1)[axis]
    middle = side * REACH + REACH  # of windows of side × side labels, row by row
    rows = windows(labels, labels, REACH)[:, middle - REACH * step : middle + REACH * step + 1 : step]
    known = (rows >= 0).all(axis=1)
    steps = np.log(np.maximum(np.linalg.norm(np.diff(xy[rows[known]], axis=1), axis=2), 1e-9))
    here, beyond, last = (steps[:, [2 - k, 3 + k]] for k in range(REACH))
    even = (here - 1.5 * beyond + 0.5 * last).mean(axis=1)
    out = np.full((len(labels), 4), np.nan)
    out[known] = np.column_stack([even, here - 2 * beyond + last, np.abs(beyond - last).max(axis=1, initial=0)])
    return out


def _between(along: Int[Array, " m"], excess: Real[Array, "m 4"]) -> Int[Array, " k"]:
    """(K,) the lines, ascending labels, that may lie between two boards: both steps to them are longer, of which a
    fold, or a seam within a square, makes one longer only. `along` (M,): the labels along the axis; `excess` (M, 4): of
    the corners."""
    known = np.isfinite(excess[:, 0])
    of = along - along.min()
    count, many = np.bincount(of[known]), np.bincount(of[known], excess[known, 0] > LONGER / 2)
    found = []
    for line in np.flatnonzero((count >= FEWEST) & (many / np.maximum(count, 1) >= AGREE)).tolist():
        even, left, right, change = medians(excess[known & (of == line)].T)
        if even > LONGER and min(left, right) >= BOTH * even and change <= CHANGE * even:
            found.append(line + along.min())
    return np.array(found, int)


def _even(pieces: Sequence[tuple[Int[Array, "n 2"], Real[Array, "n 2"]]], axis: int) -> bool:
    """Whether steps along the axis change evenly in each piece, (labels, positions), that has enough of them, and one
    has: their logarithms, medians over lines, are a polynomial of degree two. The print is uneven, otherwise."""
    enough = 0
    for labels, xy in pieces:
        steps = _steps(labels, xy, axis)
        if len(steps) >= FEWEST:
            at = np.arange(len(steps))
            off = steps - np.polynomial.polynomial.polyval(at, np.polynomial.polynomial.polyfit(at, steps, 2))
            if np.abs(off).max() > EVEN:
                return False
            enough += 1
    return enough > 0


def _steps(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], axis: int) -> Real[Array, " k"]:
    """(K,) the logarithm of the step from each line along the axis to the next, median over the corners that both
    have."""
    after = windows(labels, labels, 1)[:, (5, 7)[axis]]
    known = np.flatnonzero(after >= 0)
    steps = np.log(np.maximum(np.linalg.norm(xy[after[known]] - xy[known], axis=1), 1e-9))
    lines = labels[known, axis]
    return np.array([np.median(steps[lines == line]) for line in np.unique(lines)])
