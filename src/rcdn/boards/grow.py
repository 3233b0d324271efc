"""Completion: corners that the graph missed, where a grid's neighbours predict them and the picture agrees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid, Prediction
from rcdn.boards.validate import LEAST_QUALITY, STEPS
from rcdn.types import Array

ROUNDS = 40
NEAR, NEAR_WEAK = 0.28, 0.24
"""a corner may lie this share of the pitch from its prediction; a weak one must be closer"""
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
    quality = field.quality
    able = (field.refined | field.strong) & (
        quality >= LEAST_QUALITY * float(np.median(quality[list(grid.at.values())]))
    )
    for _ in range(ROUNDS):
        index = np.flatnonzero(free & able)
        if not len(index):
            return
        tree = cKDTree(field.xy[index])
        offers = _offers(field, grid, sign, tree, index, refused)
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
    spots = list(grid.at)
    votes = 0
    for (u, v), du in zip(spots, _steps_u(grid, spots), strict=True):
        corner = grid.at[u, v]
        if du is None or corner >= len(field.xy) or not field.polarity[corner]:  # filled corners have no colours
            continue
        colour, turn = field.side_colour(np.array([corner]), np.array([np.arctan2(du[1], du[0])]))
        votes += int(colour[0]) * (-1) ** (u + v) if turn[0] < FAR_AXIS else 0
    return int(np.sign(votes))


def _steps_u(grid: Grid, spots: list[Label]) -> list[Array | None]:
    """Vector to the next corner along u at each spot, from whichever neighbour there is."""
    out: list[Array | None] = []
    for u, v in spots:
        here = grid.xy[grid.at[u, v]]
        if (u + 1, v) in grid.at:
            out.append(grid.xy[grid.at[u + 1, v]] - here)
        elif (u - 1, v) in grid.at:
            out.append(here - grid.xy[grid.at[u - 1, v]])
        else:
            out.append(None)
    return out


class Offer(NamedTuple):
    """A corner that might take a spot: `gap` its distance from the prediction, in squares."""

    gap: float
    spot: Label
    corner: int
    axes_fit: bool


def _offers(
    field: Field, grid: Grid, sign: int, tree: cKDTree, index: Array, refused: set[tuple[Label, int]]
) -> list[Offer]:
    """Acceptable corners for the empty spots beside the grid."""
    frontier = {(u + d, v + e) for u, v in grid.at for d, e in STEPS} - set(grid.at)
    tries: list[Offer] = []
    for spot in sorted(frontier):
        guess = grid.predict(spot)
        if guess is None or guess.pitch < 2:
            continue
        for k in tree.query_ball_point(guess.xy, NEAR * guess.pitch):
            corner = int(index[k])
            gap = float(np.linalg.norm(field.xy[corner] - guess.xy)) / guess.pitch
            if (spot, corner) not in refused and (field.strong[corner] or gap < NEAR_WEAK):
                tries.append(Offer(gap, spot, corner, _axes_fit(field, corner, guess, sign * (-1) ** sum(spot))))
    seen = _edges_seen(field, grid, sign, tries)
    refused.update((t.spot, t.corner) for ok, t in zip(seen, tries, strict=True) if not ok)
    return [t for ok, t in zip(seen, tries, strict=True) if ok]


def _axes_fit(field: Field, corner: int, guess: Prediction, colour: int) -> bool:
    """Do the corner's own axes and colours fit the prediction?"""
    angles = np.array([np.arctan2(s[1], s[0]) for s in (guess.du, guess.dv)])
    colours, turns = field.side_colour(np.array([corner, corner]), angles)
    return bool(colours[0] == colour and colours[1] == -colour and (turns < FAR_AXIS).all())


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
