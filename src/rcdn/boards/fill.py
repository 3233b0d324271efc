"""Corners that the network missed, found in the picture where a finished board predicts them.

A hard shadow, glare or a scratch across a corner may silence the network, and the frame or a cover leaves it little to
see; the board's two edges still cross there, and that is looked for (`edges.crossings`). Nothing is invented: an edge
must be seen on both sides of the crossing, about as plainly as at the labelled neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.edges import crossings
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid
from rcdn.boards.validate import STEPS, inner, predicted_excess
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
ANSWERED = 0.06
"""a candidate this close to a crossing is its own, squares"""
BESIDE_PX, BESIDE = 2.5, (0.02, 0.035)
"""a labelled corner so many px, but within these squares, from its crossing lies on something else"""


class _Spot(NamedTuple):
    at: Label
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
        frontier = {(u + d, v + e) for u, v in grid.at for d, e in STEPS} - set(grid.at)
        spots = [s for at in sorted(frontier) if (s := _spot(grid, at))]
        new = _accepted(field.grey, grid, sign, spots, known, free, plain)
        if not new:
            break
        for at, (xy, corner, strength) in new.items():
            known[at] = strength
            if corner is None or not free[corner]:
                _put(grid, at, xy)
            else:
                grid.at[at], free[corner] = corner, False
        added |= set(new)
    for at in sorted(added, key=lambda a: (-predicted_excess(grid, a), a)):
        if predicted_excess(grid, at) > 1:
            del grid.at[at]


def _put(grid: Grid, at: Label, xy: Array) -> None:
    grid.at[at] = len(grid.xy)
    grid.xy = np.vstack([grid.xy, xy])


def _set_right(grey: Array, grid: Grid, sign: int) -> dict[Label, Array]:
    """Move corners to the crossing beside which they lie; returns the strengths (2,) at all.

    The edge of a shadow makes a junction with each edge of the board that it crosses; one near a corner is taken for it.
    """
    spots = [s for at in sorted(grid.at) if (s := _spot(grid, at))]
    offset, strength = _look(grey, spots, sign)
    known = {s.at: k for s, k in zip(spots, strength, strict=True)}
    moves = {}
    for spot, found, seen in zip(spots, offset, strength, strict=True):
        steps = np.stack([spot.du, spot.dv], axis=1)
        own = np.linalg.solve(steps, grid.xy[grid.at[spot.at]] - spot.xy)
        limit = np.clip(BESIDE_PX / min(np.linalg.norm(spot.du), np.linalg.norm(spot.dv)), *BESIDE)
        beside = np.abs(own - found).max() > limit and np.abs(own).max() > 1.5 * np.abs(found).max()
        if beside and np.abs(found).max() <= OFF and _shares(known, spot.at, seen).min() >= SEEN:
            moves[spot.at] = spot.xy + steps @ found
    for at, xy in moves.items():
        _put(grid, at, xy)
    return known


def _spot(grid: Grid, at: Label) -> _Spot | None:
    """A label with its neighbours' prediction; None where they say too little about it."""
    guess = grid.predict(at)
    if guess is None or guess.count < LEAST_SUPPORT or guess.pitch < 2:
        return None
    area = abs(guess.du[0] * guess.dv[1] - guess.du[1] * guess.dv[0])
    return _Spot(at, guess.xy, guess.du, guess.dv) if area > 1 else None


def _look(grey: Array, spots: list[_Spot], sign: int) -> tuple[Array, Array]:
    colour = np.array([sign * (-1) ** sum(s.at) for s in spots], float)
    xy, du, dv = (np.array([getattr(s, name) for s in spots]).reshape(-1, 2) for name in ("xy", "du", "dv"))
    return crossings(grey, xy, du, dv, colour)


def _accepted(
    grey: Array, grid: Grid, sign: int, spots: list[_Spot], known: dict[Label, Array], free: Array, plain: Array
) -> dict[Label, tuple[Array, int | None, Array]]:
    """Position (2,), candidate and strengths (2,) of the spots at which the board's edges are seen to cross.

    Beyond its rim a board vouches for nothing by itself: there it takes `plain` (N,) candidates.
    """
    out = {}
    for spot, offset, strength in zip(spots, *_look(grey, spots, sign), strict=True):
        share = _shares(known, spot.at, strength)
        if _enclosed(grid, spot.at) and (share.min() < SEEN or np.abs(offset).max() > OFF):
            # one edge shows that colours alternate; the other is where it must be
            offset = np.where(share == share.max(), offset, 0)
            seen = share.max() >= SEEN_ONE and np.abs(offset).max() <= CLOSE
        else:
            seen = share.min() >= (SEEN if inner(grid, spot.at) else SEEN_RIM) and np.abs(offset).max() <= OFF
        xy = spot.xy + offset[0] * spot.du + offset[1] * spot.dv
        corner = _candidate(grid, spot, xy, free)
        if seen and (inner(grid, spot.at) or (corner is not None and plain[corner])):
            out[spot.at] = xy, corner, strength
    return out


def _enclosed(grid: Grid, at: Label) -> bool:
    """Are all four neighbours labelled?"""
    return all((at[0] + d, at[1] + e) in grid.at for d, e in STEPS)


def _candidate(grid: Grid, spot: _Spot, xy: Array, free: Array) -> int | None:
    """The free candidate on a crossing at `xy`, or None."""
    pitch = min(np.linalg.norm(spot.du), np.linalg.norm(spot.dv))
    gap = np.where(free, np.linalg.norm(grid.xy[: len(free)] - xy, axis=1), np.inf)
    nearest = int(gap.argmin())
    return nearest if gap[nearest] < max(1.5, ANSWERED * pitch) else None


def _shares(known: dict[Label, Array], at: Label, strength: Array) -> Array:
    """How strongly the two edges are seen, (2,) shares of what is usual near the label; 0 where nothing is."""
    span = range(-2, 3)
    near = [known[s] for d in span for e in span if (d or e) and (s := (at[0] + d, at[1] + e)) in known]
    usual = np.median(near, axis=0) if near else np.zeros(2)
    return np.asarray(strength / usual) if (usual > 0).all() else np.zeros(2)
