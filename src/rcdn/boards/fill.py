"""Corners that the network missed, found in the picture where a finished board predicts them.

A hard shadow, glare or a scratch across a corner may silence the network, and the frame or a cover leaves it little to
see; the board's two edges still cross there, and that is looked for (`edges.crossings`). Nothing is invented: an edge
must be seen on both sides of the crossing, about as plainly as at the labelled neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.edges import crossings
from rcdn.boards.graph import Field, Label
from rcdn.boards.grow import SLACK
from rcdn.boards.local import Grid
from rcdn.boards.validate import STEPS, inner, predicted_excess, row_median
from rcdn.types import Array

ROUNDS = 8
LEAST_SUPPORT = 5
"""labelled neighbours that a prediction stands on"""
SEEN, SEEN_RIM = 0.35, 0.5
"""strength of both edges, share of the neighbours' median; more where the board would grow beyond its rim"""
SEEN_ONE = 0.6
"""the same for the plainer edge of a corner between four labelled ones, where a shadow may run along the other edge"""
CLOSE = 0.06
"""largest offset of that edge, squares"""
OFF = 0.14
"""largest offset from the prediction, squares"""
ANSWER = 0.6
"""least response of a candidate beyond the rim, share of the board's median"""
REACH_PX, ANSWERED = 1.5, 0.06
"""a candidate this close to a crossing is its own, px or squares"""
BESIDE_PX, BESIDE = 2.5, (0.02, 0.035)
"""a labelled corner so many px, but within these squares, from its crossing lies on something else"""


class _Spots(NamedTuple):
    """Labels with their neighbours' predictions: `xy`, `du`, `dv` (K, 2) px."""

    at: list[Label]
    xy: Array
    du: Array
    dv: Array


def fill(field: Field, grid: Grid, sign: int, free: Array) -> None:
    """Add corners to `grid`, in place, and put those right that lie beside their crossing.

    Where a candidate that is `free` (N,) bool lies on a crossing it is taken, and is free no more; otherwise the crossing's position is
    appended to `grid.xy`. `sign`: the board's colouring (`grow.board_sign`); 0 changes nothing.
    Corners that close no cell are welcome, as covers and the frame leave them.
    """
    if sign == 0:
        return
    plain = free & (field.response >= ANSWER * float(np.median(field.response[list(grid.at.values())])))
    known = _set_right(field.grey, grid, sign)
    added: set[Label] = set()
    for _ in range(ROUNDS):
        spots = _spots(grid, sorted({(u + d, v + e) for u, v in grid.at for d, e in STEPS} - set(grid.at)))
        new = _accepted(field, grid, sign, spots, known, free, plain)
        if not new:
            break
        for at, (xy, corner, strength) in new.items():
            known[at] = strength
            if corner is None or not free[corner]:
                _put(grid, at, xy)
            else:
                grid.at[at], free[corner] = corner, False
        added |= set(new)
    new_ones = sorted(added)
    excess = dict(zip(new_ones, predicted_excess(grid, new_ones).tolist(), strict=True))
    for at in sorted(added, key=lambda a: (-excess[a], a)):
        if predicted_excess(grid, [at])[0] > 1:
            del grid.at[at]


def _put(grid: Grid, at: Label, xy: Array) -> None:
    grid.at[at] = len(grid.xy)
    grid.xy = np.vstack([grid.xy, xy])


def _set_right(grey: Array, grid: Grid, sign: int) -> dict[Label, Array]:
    """Move corners to the crossing beside which they lie; returns the strengths (2,) at all.

    The edge of a shadow makes a junction with each edge of the board that it crosses; one near a corner is taken for it.
    """
    spots = _spots(grid, sorted(grid.at))
    offset, strength = _look(grey, spots, sign)
    known = dict(zip(spots.at, strength, strict=True))
    steps = np.stack([spots.du, spots.dv], axis=2)
    here = grid.xy[[grid.at[at] for at in spots.at]] - spots.xy
    own = np.linalg.solve(steps, here[..., None])[..., 0]
    limit = np.clip(BESIDE_PX / np.linalg.norm(steps, axis=1).min(axis=1), *BESIDE)
    most, found = np.abs(own).max(axis=1), np.abs(offset).max(axis=1)
    beside = (np.abs(own - offset).max(axis=1) > limit) & (most > 1.5 * found) & (found <= OFF)
    moves = {}
    for k in np.flatnonzero(beside).tolist():
        if _shares(known, [spots.at[k]], strength[k : k + 1]).min() >= SEEN:
            moves[spots.at[k]] = spots.xy[k] + steps[k] @ offset[k]
    for at, xy in moves.items():
        _put(grid, at, xy)
    return known


def _spots(grid: Grid, labels: list[Label]) -> _Spots:
    """Those of `labels` about which their neighbours say enough, with their predictions."""
    guess = grid.predictions(labels)
    area = np.abs(guess.du[:, 0] * guess.dv[:, 1] - guess.du[:, 1] * guess.dv[:, 0])
    with_sense = (guess.support >= LEAST_SUPPORT) & (guess.pitch >= 2) & (area > 1)
    some = np.flatnonzero(with_sense)
    return _Spots([labels[k] for k in some.tolist()], guess.xy[some], guess.du[some], guess.dv[some])


def _look(grey: Array, spots: _Spots, sign: int) -> tuple[Array, Array]:
    colour = np.array([sign * (-1) ** sum(at) for at in spots.at], float)
    return crossings(grey, spots.xy, spots.du, spots.dv, colour)


def _accepted(
    field: Field, grid: Grid, sign: int, spots: _Spots, known: dict[Label, Array], free: Array, plain: Array
) -> dict[Label, tuple[Array, int | None, Array]]:
    """Position (2,), candidate and strengths (2,) of the spots at which the board's edges are seen to cross.

    Beyond its rim a board vouches for nothing by itself: there it takes `plain` (N,) candidates.
    """
    offset, strength = _look(field.grey, spots, sign)
    share, within = _shares(known, spots.at, strength), inner(grid, spots.at)
    far = np.abs(offset).max(axis=1, initial=0)
    # where one edge shows that colours alternate, the other is where it must be
    one = _enclosed(grid, spots.at) & ((share.min(axis=1, initial=np.inf) < SEEN) | (far > OFF))
    offset = np.where(one[:, None] & (share < share.max(axis=1, initial=0, keepdims=True)), 0, offset)
    far = np.abs(offset).max(axis=1, initial=0)
    both = (share.min(axis=1, initial=np.inf) >= np.where(within, SEEN, SEEN_RIM)) & (far <= OFF)
    seen = np.where(one, (share.max(axis=1, initial=0) >= SEEN_ONE) & (far <= CLOSE), both)
    xy = spots.xy + offset[:, :1] * spots.du + offset[:, 1:] * spots.dv
    out = {}
    some = np.flatnonzero(seen)
    for k, corner in zip(some.tolist(), _candidates(field, grid, spots, xy, some, free), strict=True):
        if within[k] or (corner is not None and plain[corner]):
            out[spots.at[k]] = xy[k], corner, strength[k]
    return out


def _enclosed(grid: Grid, labels: list[Label]) -> Array:
    """(K,) bool: are all four neighbours labelled?"""
    near = grid.around(labels, 1) >= 0
    return np.asarray(near[:, [1, 3, 5, 7]].all(axis=1))


def _candidates(field: Field, grid: Grid, spots: _Spots, xy: Array, some: Array, free: Array) -> list[int | None]:
    """The free candidate on the crossing `xy` of each of `some` (J,) spots, or None."""
    pitch = np.sqrt(np.minimum((spots.du**2).sum(axis=1), (spots.dv**2).sum(axis=1)))
    reach = np.maximum(REACH_PX, ANSWERED * pitch)
    field.look(xy[some], reach[some] + SLACK)
    if grid.xy is not field.xy:
        grid.xy[: len(free)] = field.xy
    index = np.flatnonzero(free & (~field.waiting if field.waiting is not None else True))
    if not len(index) or not len(some):
        return [None] * len(some)
    gap, nearest = cKDTree(field.xy[index]).query(xy[some])
    return [int(index[n]) if g < r else None for g, n, r in zip(gap, nearest, reach[some], strict=True)]


def _shares(known: dict[Label, Array], labels: list[Label], strength: Array) -> Array:
    """How strongly the two edges are seen, (K, 2) shares of what is usual near the labels; 0 where nothing is."""
    every = Grid({at: k for k, at in enumerate(known)}, np.zeros((0, 2)))
    near = every.around(labels, 2)
    near[:, near.shape[1] // 2] = -1
    values = np.array(list(known.values())).reshape(-1, 2)
    if not len(values):
        return np.zeros((len(labels), 2))
    usual = np.stack([row_median(values[near, k], near >= 0) for k in (0, 1)], axis=1)
    fine = (usual > 0).all(axis=1, keepdims=True)
    return np.where(fine, strength / np.where(fine, usual, 1), 0)
