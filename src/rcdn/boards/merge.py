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
    motion, back = _motion(host, guest), _motion(guest, host)
    if motion is None or back is None or not _inverse(motion, back):
        return None
    moved = {_move(motion, spot): corner for spot, corner in guest.at.items()}
    parity = (-1) ** sum(motion)
    if set(moved) & set(host.at) or board_sign(field, guest) != parity * board_sign(field, host):
        return None
    return Grid(host.at | moved, host.xy)


def _inverse(motion: Motion, back: Motion) -> bool:
    return all(_move(back, _move(motion, spot)) == spot for spot in ((0, 0), (1, 0), (0, 1)))


def _move(motion: Motion, spot: Label) -> Label:
    u, v = spot
    for _ in range(motion[0]):
        u, v = -v, u
    return u + motion[1], v + motion[2]


def _motion(host: Grid, guest: Grid) -> Motion | None:
    """The turn and shift that take the guest's labels to the host's, or None if there is no clear one."""
    spots = list(host.at)
    tree = cKDTree(host.xy[list(host.at.values())])
    votes: Counter[Motion] = Counter()
    voters = 0
    for spot, corner in sorted(guest.at.items()):
        near = spots[int(tree.query(guest.xy[corner])[1])]
        offset, steps = _offset(host, near, guest.xy[corner])
        whole = np.rint(offset)
        reach = float(np.abs(whole).max())
        if not 1 <= reach <= GAP:
            continue
        voters += 1
        if np.abs(offset - whole).max() > OFF * reach:
            continue
        for turns in range(4):
            if _same_steps(guest, spot, turns, steps):
                u, v = _move((turns, 0, 0), spot)
                votes[turns, near[0] + int(whole[0]) - u, near[1] + int(whole[1]) - v] += 1
    if not votes:
        return None
    motion, count = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return motion if count >= max(LEAST_VOTES, SHARE * voters) else None


def _offset(host: Grid, near: Label, xy: Array) -> tuple[Array, Array]:
    """Offset (2,) in squares of a position from the host's corner `near`, and the host's steps there (columns du, dv); inf if unknown."""
    here = host.predict(near)
    steps = np.eye(2) if here is None else np.stack([here.du, here.dv], axis=1)
    if here is None or abs(np.linalg.det(steps)) < 1e-6:
        return np.full(2, np.inf), steps
    return np.linalg.solve(steps, xy - host.xy[host.at[near]]), steps


def _same_steps(guest: Grid, spot: Label, turns: int, steps: Array) -> bool:
    """Are the guest's steps at `spot`, after its turn, the host's `steps` (2, 2) but for a quarter of a square?"""
    here = guest.predict(spot)
    if here is None:
        return False
    du, dv = here.du, here.dv
    for _ in range(turns):  # labels turn by (u, v) -> (-v, u): the step along the new u is the old step along -v
        du, dv = -dv, du
    difference = np.linalg.solve(steps, np.stack([du, dv], axis=1)) - np.eye(2)
    return bool(np.linalg.norm(difference, axis=0).max() < STRETCH)
