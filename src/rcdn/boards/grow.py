"""Completion: corners that the graph missed, where a grid's neighbours predict them and the picture agrees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid
from rcdn.boards.validate import LEAST_QUALITY, STEPS
from rcdn.types import Array

ROUNDS = 40
NEAR, NEAR_WEAK = 0.28, 0.24
"""a corner may lie this share of the pitch from its prediction; a weak one must be closer"""
PLAIN = 5
"""corners that a grid must have before weak peaks are looked at: no board is one whose corners are mostly weak (`validate.plain`)"""
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
    level = LEAST_QUALITY * float(np.median(field.quality[list(grid.at.values())]))
    for _ in range(ROUNDS):
        offers = _offers(field, grid, sign, free, level, refused)
        if not offers:
            return
        taken: set[int] = set()
        for _, spot, corner, _ in sorted(offers):
            if spot not in grid.at and corner not in taken:
                grid.at[spot] = corner
                taken.add(corner)
                free[corner] = False


def board_sign(field: Field, grid: Grid) -> int:
    """The board's colouring: side colour of the u axis times (−1)^(u+v), by majority; 0 if undecided."""
    spots = np.array(list(grid.at), np.int64).reshape(-1, 2)
    corner = np.array(list(grid.at.values()), np.int64)
    near = grid.around(spots, 1)
    ahead, behind = near[:, 5], near[:, 3]
    step = np.where((ahead >= 0)[:, None], grid.xy[ahead] - grid.xy[corner], grid.xy[corner] - grid.xy[behind])
    votes = ((ahead >= 0) | (behind >= 0)) & (corner < len(field.xy))  # filled corners have no colours
    index = corner[votes]
    colour, turn = field.side_colour(index, np.arctan2(step[votes, 1], step[votes, 0]))
    parity = 1 - 2 * (spots[votes].sum(axis=1) % 2)
    return int(np.sign((colour * parity)[turn < FAR_AXIS].sum()))


class Offer(NamedTuple):
    """A corner that might take a spot: `gap` its distance from the prediction, in squares."""

    gap: float
    spot: Label
    corner: int
    axes_fit: bool


def _offers(
    field: Field, grid: Grid, sign: int, free: Array, level: float, refused: set[tuple[Label, int]]
) -> list[Offer]:
    """Acceptable corners, of a quality over `level`, for the empty spots beside the grid."""
    frontier = sorted({(u + d, v + e) for u, v in grid.at for d, e in STEPS} - set(grid.at))
    guess = grid.predictions(frontier)
    pitch = np.where(guess.support > 0, guess.pitch, 0)
    rows = np.flatnonzero(pitch >= 2)
    if not len(rows):
        return []
    if len(grid) >= PLAIN:
        field.look(guess.xy[rows], NEAR * pitch[rows] + SLACK)
    index = np.flatnonzero(free & (field.refined | field.strong) & (field.quality >= level))
    if not len(index):
        return []
    near = cKDTree(field.xy[index]).query_ball_point(guess.xy[rows], NEAR * pitch[rows])
    tries = [(int(r), int(index[k])) for r, own in zip(rows, near, strict=True) for k in own]
    tries = [(r, k) for r, k in tries if (frontier[r], k) not in refused]
    row, corner = np.array(tries, int).reshape(-1, 2).T
    gap = np.linalg.norm(field.xy[corner] - guess.xy[row], axis=1) / pitch[row]
    colour = sign * np.array([(-1) ** sum(frontier[r]) for r in row.tolist()], int)
    fits = _axes_fit(field, corner, guess.du[row], guess.dv[row], colour)
    close = field.strong[corner] | (gap < NEAR_WEAK)
    asked = [
        Offer(float(gap[k]), frontier[row[k]], int(corner[k]), bool(fits[k])) for k in np.flatnonzero(close).tolist()
    ]
    seen = _edges_seen(field, grid, sign, asked)
    refused.update((t.spot, t.corner) for ok, t in zip(seen, asked, strict=True) if not ok)
    return [t for ok, t in zip(seen, asked, strict=True) if ok]


def _axes_fit(field: Field, corner: Array, du: Array, dv: Array, colour: Array) -> Array:
    """(K,) bool: do the corners' own axes and colours fit the predicted steps (K, 2)?"""
    fits = np.ones(len(corner), bool)
    for step, expected in ((du, colour), (dv, -colour)):
        own, turn = field.side_colour(corner, np.arctan2(step[:, 1], step[:, 0]))
        fits &= (own == expected) & (turn < FAR_AXIS)
    return fits


def _edges_seen(field: Field, grid: Grid, sign: int, tries: list[Offer]) -> list[bool]:
    """For each offer: are the edges to its labelled neighbours in the picture?

    One is enough for a strong corner whose axes fit, if none speaks against it; otherwise all must be seen, and two at least
    where the axes don't fit (motion blur bends them).
    """
    rows, starts, ends, signs, levels = [], [], [], [], []
    for row, offer in enumerate(tries):
        (u, v), corner = offer.spot, offer.corner
        for d, e in STEPS:
            other = grid.at.get((u + d, v + e))
            if other is None:
                continue
            rows.append(row)
            starts.append(field.xy[corner])
            ends.append(field.xy[other])
            signs.append(sign * (-1) ** (u + v) * (1 if d else -1))
            levels.append(field.contrast[other])
    if not rows:
        return [False] * len(tries)
    shown = edge_contrast(field.grey, np.array(starts), np.array(ends)) * np.array(signs)[:, None]
    share, row_of = shown / np.maximum(np.array(levels), 1e-6)[:, None], np.array(rows)
    out: list[bool] = []
    for row, offer in enumerate(tries):
        own = share[row_of == row]
        if field.strong[offer.corner] and offer.axes_fit:
            out.append(bool((own.min(axis=1) > SHOWN).any() and (own.mean(axis=1) > 0).all()))
        else:
            out.append(bool(len(own) >= (1 if offer.axes_fit else 2) and (own.min(axis=1) > SHOWN_WEAK).all()))
    return out
