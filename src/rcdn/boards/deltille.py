"""Boards of triangles: from six-sector corners to labelled lattices (paper section 4.5). No board size is needed.

As for squares: mutual links, cells that the image confirms, a flood fill over them (`boards.triangles`), then corners
at predicted positions of the lattice, and a validation that only removes corners.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.convert import as_board
from rcdn.boards.graph import Field
from rcdn.boards.local import Grid, Predictions, spots_beside
from rcdn.boards.six_sided import (
    ALIKE,
    ALIKE_SEARCHED,
    REACH,
    believable,
    median_contrast,
    shortest,
    six_sided,
    validate,
)
from rcdn.boards.triangles import FIT, as_six_sided, cells, label, links
from rcdn.corners import Candidates
from rcdn.corners.peaks import SAME
from rcdn.corners.six_sector import antisymmetry, ring, six_axes
from rcdn.geometry.elementary import arctan2
from rcdn.geometry.near import nearest, within
from rcdn.geometry.rules import TRIANGLES, Label
from rcdn.types import Array, Board, Status
from rcdn.types.arrays import Bool, Shaped

NEAR = 0.22
"""largest distance of a corner from its prediction, share of the shortest step"""
NEAR_SEARCHED, FIT_SEARCHED = 0.12, 0.6
"""the same, and the least `fit`, for a corner at which the network gave no response"""
SUPPORT, SHORTEST = 3, 3.0
"""fewest labelled corners that a prediction needs, and least step there, px"""
ROUNDS = 60
"""of growth, at most"""


def find_deltilles(
    grey: Shaped[Array, "h w"], candidates: Candidates, least: int = 9, scale: float = 1.0
) -> list[Board]:
    """Deltilles among six-sector corners (`six_candidates`), the one with the most corners first; [] if there is none.

    `grey` (H, W); `least`: fewest corners of a board, which also needs six complete triangles;
    `scale`: px of `grey` per px of the original image if `grey` is an enlargement (tiny triangles are trusted less).
    """
    field = as_six_sided(grey, candidates)
    free, boards = candidates.all.status != Status.SEED, []
    for at, sign in label(field, cells(field, links(field))):
        grid = Grid({spot: corner for spot, corner in at.items() if free[corner]}, field.xy)
        if len(grid) < 3:
            continue
        validate(field, grid, sign)
        _grow(field, grid, sign, free)
        validate(field, grid, sign)
        if believable(field, grid, least, scale):
            held = np.array(list(grid.at.values()))
            free[held[held < len(free)]] = False
            boards.append(as_board(field, candidates, grid, TRIANGLES, sign))
    return sorted(boards, key=lambda b: (-len(b), *b.xy[0]))


# ---- completion


def _grow(field: Field, grid: Grid, sign: int, free: Array) -> None:
    """Add corners, nearest to their prediction first, until nothing changes.

    Where the network gave no candidate, the image itself is searched.
    """
    if not grid.at:
        return
    open_ = free.copy()
    open_[list(grid.at.values())] = False
    refused: set[tuple[Label, int]] = set()
    for _ in range(ROUNDS):
        spots = _spots_beside(grid)
        offers = _offers(field, grid, sign, open_, spots, refused)
        if not offers:
            return
        for offer in sorted(offers, key=lambda o: o[:3]):
            _take(field, grid, open_, spots.labels[offer.row], offer)


class _Spots(NamedTuple):
    """Empty spots beside a lattice: `labels` (K), their predictions, and the shortest step there, `step` (K,) px."""

    labels: list[Label]
    guess: Predictions
    step: Array


def _spots_beside(grid: Grid) -> _Spots:
    labels = spots_beside(grid.at, REACH)
    guess = grid.predictions(labels)
    step = shortest(guess)
    rows = np.flatnonzero((guess.support >= SUPPORT) & (np.nan_to_num(step) >= SHORTEST))
    return _Spots([labels[k] for k in rows], Predictions(*(a[rows] for a in guess)), step[rows])


class _Offer(NamedTuple):
    """A corner offered for spot number `row`: `corner`, or −1 if new, at `xy` (2,); `gap`: its distance from the
    prediction, steps."""

    gap: float
    row: int
    corner: int
    xy: Array


def _take(field: Field, grid: Grid, open_: Array, spot: Label, offer: _Offer) -> None:
    """Assign the offered corner to the spot, unless either has been taken in the meantime."""
    corner = offer.corner
    if spot in grid.at or (corner >= 0 and not open_[corner]):
        return
    if corner >= 0:
        open_[corner] = False
    elif nearest(grid.xy[list(grid.at.values())], offer.xy)[0][0, 0] < SAME:
        return
    else:
        corner = len(grid.xy)
        grid.append([offer.xy], field.xy)
    grid.at[spot] = corner


def _offers(
    field: Field, grid: Grid, sign: int, open_: Array, spots: _Spots, refused: set[tuple[Label, int]]
) -> list[_Offer]:
    """Unlabelled candidates that may fill a spot and, where none is near, a corner found in the image there."""
    tries = _tries(field, open_, spots, refused)
    if not tries:
        return []
    row, corner = np.array([t[:2] for t in tries]).T
    xy, guess, step = np.array([t[2] for t in tries]), spots.guess, spots.step[row]
    du, dv, silent = guess.du[row], guess.dv[row], corner < 0
    gap = np.linalg.norm(xy - guess.xy[row], axis=1) / step
    orientation = six_axes(field.grey, xy, ring(step))
    fine = (gap < np.where(silent, NEAR_SEARCHED, NEAR)) & (orientation.fit >= np.where(silent, FIT_SEARCHED, FIT))
    fine &= (orientation.polarity != 0) & _axes_fit(orientation.axes, du, dv)
    typical = median_contrast(field, grid, sign, spots.labels, guess.du, guess.dv)
    fine &= six_sided(field.grey, xy, du, dv, sign) > np.where(silent, ALIKE_SEARCHED, ALIKE) * typical[row]
    refused.update((spots.labels[r], c) for (r, c, _), f in zip(tries, fine.tolist(), strict=True) if not f)
    return [_Offer(float(gap[k]), *tries[k]) for k in np.flatnonzero(fine)]


def _tries(field: Field, open_: Array, spots: _Spots, refused: set[tuple[Label, int]]) -> list[tuple[int, int, Array]]:
    """(row of a spot, corner or −1, position) of all corners near enough to a spot to be tested that were not
    refused."""
    out, silent = [], np.ones(len(spots.labels), bool)
    index = np.flatnonzero(open_)
    if len(index) and len(silent):
        near = within(field.xy[index], spots.guess.xy, NEAR * spots.step)
        out = [(int(row), int(c), field.xy[c]) for row, c in zip(near[0], index[near[1]], strict=True)]
        silent[[row for row, _, _ in out]] = False
        out = [t for t in out if (spots.labels[t[0]], t[1]) not in refused]
    silent &= np.array([(label, -1) not in refused for label in spots.labels], bool)
    rows = np.flatnonzero(silent & (spots.guess.support > SUPPORT))
    found = antisymmetry(field.grey, spots.guess.xy[rows], spots.step[rows])
    seen = np.isfinite(found).all(axis=1) & _inside(found, field.grey.shape)
    return out + [(int(row), -1, xy) for row, xy in zip(rows[seen], found[seen], strict=True)]


def _inside(xy: Array, shape: tuple[int, ...]) -> Array:
    return np.asarray(((xy >= 3) & (xy <= np.array(shape[::-1]) - 4)).all(axis=1))


def _axes_fit(axes: Array, du: Array, dv: Array) -> Bool[Array, " k"]:
    """(K,) bool: whether each lattice direction has an axis (K, 3) of its own, closer than half the angle to the next
    direction."""
    angle = np.stack([arctan2(s[:, 1], s[:, 0]) for s in (du, dv, dv - du)], axis=1)
    turn = np.abs((angle[:, :, None] - axes[:, None] + np.pi / 2) % np.pi - np.pi / 2)
    order = np.sort(angle % np.pi, axis=1)
    room = np.column_stack([np.diff(order, axis=1), order[:, :1] + np.pi - order[:, 2:]]).min(axis=1)
    turn = np.where(np.isfinite(turn), turn, np.pi)
    own = turn.argmin(axis=2)
    apart = (own[:, 0] != own[:, 1]) & (own[:, 1] != own[:, 2]) & (own[:, 0] != own[:, 2])
    return np.asarray(apart & (turn.min(axis=2).max(axis=1) < np.maximum(0.5 * room, np.deg2rad(8))))
