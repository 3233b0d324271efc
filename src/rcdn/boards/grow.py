"""Completion: corners that the graph missed, where a grid's neighbours predict them and the picture agrees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid, Predictions, checked
from rcdn.boards.validate import LEAST_QUALITY
from rcdn.native import bind
from rcdn.types import Array

_sign = bind("rcdn_grid_sign", "lddlnrL", result=True)
_offered = bind("rcdn_grid_offers", "lnlddnddlbbnnrrrLDBLn", result=True)
ROUNDS = 40
NEAR, NEAR_WEAK = 0.28, 0.24
"""a corner may lie this share of the pitch from its prediction; a weak one must be closer"""
LEAST_PITCH = 2.0
"""px; smaller squares are none"""
PLAIN = 5
"""corners that a grid must have before weak peaks are looked at: no board is one whose corners are mostly weak (`validate.plain`)"""
ROOM = 16
"""corners near an open spot that are usual"""
SLACK = 3.0
"""px by which refinement may move a peak"""
FAR_AXIS = np.deg2rad(30)
SHOWN, SHOWN_WEAK = 0.2, 0.3
"""share of the board's contrast that an edge to a labelled neighbour shows"""


def grow(field: Field, grid: Grid, free: Array) -> None:
    """Add corners to `grid`, nearest to their prediction first, until nothing changes. `free` (N,) bool: corners that may be taken; updated.

    A corner is taken if it lies within 0.28 of a square of its prediction (0.24 if it is weak), its axes and colours fit the
    board where they are known, and the edges to its labelled neighbours are in the picture. Drops nothing and renames nothing.
    """
    sign = board_sign(field, grid)
    if sign == 0:
        return
    refused: set[tuple[Label, int]] = set()
    corners = grid.corners
    level = LEAST_QUALITY * float(np.median(field.response[corners] * field.fit[corners]))
    for _ in range(ROUNDS):
        offers = _offers(field, grid, sign, free, level, refused)
        if not offers:
            return
        taken: set[int] = set()
        for _, spot, corner in sorted(offers):
            if spot not in grid.at and corner not in taken:
                grid.at[spot] = corner
                taken.add(corner)
                free[corner] = False


def board_sign(field: Field, grid: Grid) -> int:
    """The board's colouring: side colour of the u axis times (−1)^(u+v), by majority; 0 if undecided."""
    labels, corners, votes = grid.labels, grid.corners, np.zeros(1, np.int64)
    own = np.minimum(corners, len(field.xy) - 1)
    polarity = np.where(corners < len(field.xy), field.polarity[own], 0)  # filled corners have no colours
    checked(_sign(labels, grid.xy[corners], field.axes[own], polarity, len(labels), FAR_AXIS, votes))
    return int(np.sign(votes[0]))


class Offer(NamedTuple):
    """A corner that might take a spot: `gap` its distance from the prediction, in squares."""

    gap: float
    spot: Label
    corner: int


def _offers(
    field: Field, grid: Grid, sign: int, free: Array, level: float, refused: set[tuple[Label, int]]
) -> list[Offer]:
    """Acceptable corners, of a quality over `level`, for the empty spots beside the grid."""
    spots, guess = grid.beside()
    rows = np.flatnonzero(guess.pitch >= LEAST_PITCH)
    if not len(rows):
        return []
    spots, guess = spots[rows], guess.take(rows)
    if len(grid) >= PLAIN:
        field.look(guess.xy, NEAR * guess.pitch + SLACK)
    usable = free & (field.refined | field.strong) & (field.quality >= level)
    offers, gap, fits, beside = _near(field, grid, sign, spots, guess, usable)
    keys = list(zip(map(tuple, spots[offers[:, 0]].tolist()), offers[:, 1].tolist(), strict=True))
    asked = [k for k, key in enumerate(keys) if key not in refused]
    if not asked:
        return []
    parity = sign * (1 - 2 * (spots[offers[asked, 0]].sum(axis=1) % 2))
    seen = _edges_seen(field, grid, parity, offers[asked, 1], fits[asked], beside[asked])
    refused.update(keys[k] for k, ok in zip(asked, seen.tolist(), strict=True) if not ok)
    return [Offer(float(gap[k]), *keys[k]) for k, ok in zip(asked, seen.tolist(), strict=True) if ok]


def _near(
    field: Field, grid: Grid, sign: int, spots: Array, guess: Predictions, usable: Array
) -> tuple[Array, Array, Array, Array]:
    """Corners that are `usable` (N,) and near enough to `spots` (K, 2): rows of spots and corners (M, 2), their distance from the prediction (M,),
    squares, whether their own axes and colours fit the predicted steps (M,), and rows of the labelled corners (M, 4) in the directions
    `STEPS`, −1 for none.
    """
    labels, room = grid.labels, ROOM + 2 * len(spots)
    maps, pitch = np.ascontiguousarray(guess.maps), np.ascontiguousarray(guess.pitch)
    while True:
        offers, gap, fits = np.empty((room, 2), np.int64), np.empty(room), np.empty(room, np.uint8)
        beside = np.empty((room, 4), np.int64)
        count = checked(
            _offered(
                labels, len(labels), spots, maps, pitch, len(spots),
                field.xy, field.axes, field.polarity, usable.view(np.uint8), field.strong.view(np.uint8), len(usable),
                sign, NEAR, NEAR_WEAK, FAR_AXIS, offers, gap, fits, beside, room,
            )
        )  # fmt: skip
        if count <= room:
            return offers[:count], gap[:count], fits[:count] > 0, beside[:count]
        room = count


def _edges_seen(field: Field, grid: Grid, parity: Array, corner: Array, fits: Array, beside: Array) -> Array:
    """(K,) bool: are the edges from each `corner` (K,) to the corners `beside` (K, 4) its spot in the picture?

    One is enough for a strong corner whose axes fit, if none speaks against it; otherwise all must be seen, and two at least
    where the axes don't fit (motion blur bends them). `parity` (K,) ±1: colour of the spot's side along u.
    """
    there = beside >= 0
    row, way = np.nonzero(there)
    other = grid.corners[beside[row, way]]
    colour = parity[row] * np.where(way % 2 == 0, 1, -1)
    shown = edge_contrast(field.grey, field.xy[corner[row]], field.xy[other]) * colour[:, None]
    share = shown / np.maximum(field.contrast[other], 1e-6)[:, None]
    least, mean = np.zeros(beside.shape), np.zeros(beside.shape)
    least[row, way], mean[row, way] = share.min(axis=1, initial=np.inf), share.mean(axis=1)
    some = ((least > SHOWN) & there).any(axis=1) & ((mean > 0) | ~there).all(axis=1)
    every = ((least > SHOWN_WEAK) | ~there).all(axis=1) & (there.sum(axis=1) >= np.where(fits, 1, 2))
    return np.where(field.strong[corner] & fits, some, every)
