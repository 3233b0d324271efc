"""Parts of one board that a shadow, a finger or a glare has torn apart are put together again."""

from __future__ import annotations

from collections import Counter

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.graph import Field, Label
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.types import Array

GAP = 3
"""parts may lie this many squares apart"""
OFF = 0.08
"""largest distance from a lattice point of the other part, squares, for each square of the gap"""
STRETCH = 0.25
"""largest difference of the two lattices' steps where they face each other, squares"""
LEAST_VOTES, SHARE = 3, 0.8
Motion = tuple[int, int, int]
"""quarter turns, shift in u, shift in v"""


def merge(field: Field, grids: list[Grid]) -> list[Grid]:
    """Join grids whose lattices are one, larger ones first; what doesn't join stays as it is.

    A part joins if at least three of its corners, and four fifths of those near enough to tell, lie on continued lattice points of the
    other under one turn and shift, and the other way round too; if their steps are alike where they face each other; if colours agree, and no
    label is taken.
    """
    left = sorted(grids, key=lambda g: (-len(g), min(g.at.values())))
    out: list[Grid] = []
    while left:
        host = left.pop(0)
        k = 0
        while k < len(left):
            joined = _join(field, host, left[k])
            if joined is None:
                k += 1
            else:
                host = joined
                left.pop(k)
                k = 0
        out.append(host)
    return out


def _join(field: Field, host: Grid, guest: Grid) -> Grid | None:
    if _apart(host, guest):
        return None
    motion, back = _motion(host, guest), _motion(guest, host)
    if motion is None or back is None or not _inverse(motion, back):
        return None
    moved = {_move(motion, spot): corner for spot, corner in guest.at.items()}
    parity = (-1) ** sum(motion)
    if set(moved) & set(host.at) or board_sign(field, guest) != parity * board_sign(field, host):
        return None
    return Grid(host.at | moved, host.xy)


def _apart(host: Grid, guest: Grid) -> bool:
    """Are two grids surely further apart than `GAP` squares of either?"""
    boxes, squares = [], []
    for grid in (host, guest):
        xy = grid.xy[list(grid.at.values())]
        boxes.append((xy.min(axis=0), xy.max(axis=0)))
        guess = grid.predictions(list(grid.at))
        squares.append(np.nanmax(np.abs(np.stack([guess.du, guess.dv])), axis=(0, 1), initial=0).sum())
    gap = np.maximum(boxes[0][0] - boxes[1][1], boxes[1][0] - boxes[0][1]).max()
    return bool(gap > (GAP + 1) * max(squares) * 2)


def _inverse(motion: Motion, back: Motion) -> bool:
    return all(_move(back, _move(motion, spot)) == spot for spot in ((0, 0), (1, 0), (0, 1)))


def _move(motion: Motion, spot: Label) -> Label:
    u, v = spot
    for _ in range(motion[0]):
        u, v = -v, u
    return u + motion[1], v + motion[2]


def _motion(host: Grid, guest: Grid) -> Motion | None:
    """The turn and shift that take the guest's labels to the host's, or None if there is no clear one."""
    held, spots = np.array(list(host.at)), np.array(sorted(guest.at))
    xy = guest.xy[[guest.at[s] for s in sorted(guest.at)]]
    near = held[cKDTree(host.xy[list(host.at.values())]).query(xy)[1]]
    offset, steps = _offset(host, near, xy)
    whole = np.rint(offset)
    reach = np.abs(whole).max(axis=1)
    voters = (reach >= 1) & (reach <= GAP)
    close = voters & (np.abs(offset - whole).max(axis=1) <= OFF * reach)
    if not close.any():
        return None
    spots, near, whole, steps = (a[close] for a in (spots, near, whole, steps))
    votes: Counter[Motion] = Counter()
    alike = _same_steps(guest, spots, steps)
    for spot, base, turns in zip(spots.tolist(), (near + whole).astype(int).tolist(), alike, strict=True):
        for turn in np.flatnonzero(turns).tolist():
            u, v = _move((turn, 0, 0), (spot[0], spot[1]))
            votes[turn, base[0] - u, base[1] - v] += 1
    if not votes:
        return None
    motion, count = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return motion if count >= max(LEAST_VOTES, SHARE * int(voters.sum())) else None


def _offset(host: Grid, near: Array, xy: Array) -> tuple[Array, Array]:
    """Offsets (K, 2) in squares of positions from the host's corners at `near` (K, 2), and the host's steps there (K, 2, 2), columns du, dv.

    inf where they are unknown.
    """
    here = host.predictions(list(map(tuple, near.tolist())))
    steps = np.stack([here.du, here.dv], axis=2)
    known = (here.support > 0) & (np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]) >= 1e-6)
    steps = np.where(known[:, None, None], steps, np.eye(2))
    away = xy - host.xy[[host.at[u, v] for u, v in near.tolist()]]
    return np.where(known[:, None], np.linalg.solve(steps, away[..., None])[..., 0], np.inf), steps


def _same_steps(guest: Grid, spots: Array, steps: Array) -> Array:
    """(K, 4) bool: are the guest's steps at `spots` (K, 2), after so many turns, the host's `steps` (K, 2, 2) but for a quarter of a square?"""
    here = guest.predictions(list(map(tuple, spots.tolist())))
    du, dv, out = here.du, here.dv, []
    for _ in range(4):
        difference = np.linalg.solve(steps, np.stack([du, dv], axis=2)) - np.eye(2)
        out.append(np.linalg.norm(difference, axis=1).max(axis=1, initial=0) < STRETCH)
        du, dv = -dv, du  # labels turn by (u, v) -> (-v, u): the step along the new u is the old step along -v
    return np.stack(out, axis=1)
