"""Pieces of boards that the recovery leaves out, for code readers: a decoded code is proof enough, so that pieces may
be uncertain.

Glare, hands and markers too close to their neighbours disturb the links of a board. Here cells are made of any four
corners that are placed like those of a square and agree on its colour; an edge may be covered over a third of its
length. Only a code turns such a piece into a board.
"""

from __future__ import annotations

import numpy as np

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, label
from rcdn.geometry.elementary import arctan2
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import Label
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

_three_of_quads = bind("rcdn_three_of_quads")

AROUND = 10
"""number of nearest neighbours with which a corner may form cells"""
MOST_CORNERS = 250
"""largest number of corners that are used, the ones of highest quality in the image"""
SKEW, RATIO = 0.35, 2.5
"""least sine of the angle between a cell's sides, and largest ratio of their lengths"""
OFF = 0.22
"""largest distance of a cell's fourth corner from the parallelogram of the others, share of the shorter side"""
TURN = np.deg2rad(32)
"""largest angle between a side and the axes of its corners, radians"""
SHOWN = 0.12
"""least contrast of two thirds of a side, share of its corners' """
LEAST_CORNERS = 6
"""fewest corners of a piece"""
PIECES = 6
"""largest number of pieces in an image; the largest are kept"""
QUALITY = 0.12
"""least response × fit of a corner"""


def fragments(field: Field, free: Bool[Array, " n"], known: int) -> list[dict[Label, int]]:
    """Grids {(u, v): corner} among the corners that are `free` (N,) bool, of the first `known`, the largest first.

    Each has six corners or more and the colours of a board, but may be no board at all.
    """
    usable = free & (field.polarity != 0) & (field.quality >= QUALITY)
    usable[known:] = False
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(-field.quality[rows], kind="stable")][:MOST_CORNERS]
    if len(rows) < LEAST_CORNERS:
        return []
    quads = _shown(field, _coloured(field, rows[_quads(field.xy[rows])]))
    grids = [grid for grid in label(field, quads) if len(grid) >= LEAST_CORNERS]
    return sorted(grids, key=lambda g: (-len(g), min(g.values())))[:PIECES]


def _quads(xy: Real[Array, "n 2"]) -> Real[Array, "q 4"]:
    """Quadruples (Q, 4) of rows of `xy` (N, 2) placed like the corners of a square, clockwise on the screen, each
    once."""
    xy, count = np.ascontiguousarray(xy, np.float64), len(xy)
    length, near = (np.ascontiguousarray(a[:, 1:]) for a in nearest(xy, xy, min(AROUND, count - 1) + 1))
    room = count * near.shape[1] ** 2
    three, fourth, side = np.empty((room, 3), np.int64), np.empty((room, 2)), np.empty(room)
    found = _three_of_quads(xy, near, length, SKEW, RATIO, three, fourth, side)
    gap, d = nearest(xy, fourth[:found], 1)
    close = gap[:, 0] < OFF * side[:found]
    a, b, c = three[:found][close].T
    quads = np.stack([a, b, d[close, 0], c], axis=1)
    first = quads.argmin(axis=1)[:, None]
    quads = np.take_along_axis(quads, (first + np.arange(4)) % 4, axis=1)
    return np.stack(np.unravel_index(np.unique(quads @ count ** np.arange(3, -1, -1)), (count,) * 4), axis=1)


def _coloured(field: Field, quads: Real[Array, "q 4"]) -> Array:
    """The `quads` (Q, 4) whose sides lie along their corners' axes and whose corners agree on the colour inside."""
    step = field.xy[np.roll(quads, -1, axis=1)] - field.xy[quads]
    colour, turn = field.side_colour(quads, arctan2(step[..., 1], step[..., 0]))
    return quads[(turn < TURN).all(axis=1) & (np.abs(colour.sum(axis=1)) == 4)]


def _shown(field: Field, quads: Real[Array, "q 4"]) -> Array:
    """The `quads` (Q, 4) whose four sides are visible in the image, each over at least two thirds of its length."""
    start, end = quads.ravel(), np.roll(quads, -1, axis=1).ravel()
    contrast = edge_contrast(field.grey, field.xy[start], field.xy[end])
    step = field.xy[end] - field.xy[start]
    colour = field.side_colour(start, arctan2(step[:, 1], step[:, 0]))[0]
    expected = np.minimum(field.contrast[start], field.contrast[end])
    seen = (contrast * colour[:, None] > SHOWN * expected[:, None]).sum(axis=1) >= 2
    return quads[seen.reshape(-1, 4).all(axis=1)]
