"""Parts of one board that a shadow, a finger or a glare has torn apart are put together again."""

from __future__ import annotations

from collections import Counter

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.graph import Field, Label
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.boards.validate import prune
from rcdn.types import Array

GAP = 2
"""parts may lie this many squares apart"""
OFF = 0.3
"""largest distance from a lattice point of the other part, squares"""
LEAST_VOTES, SHARE = 3, 0.8
Motion = tuple[int, int, int]
"""quarter turns, shift in u, shift in v"""


def merge(field: Field, grids: list[Grid]) -> list[Grid]:
    """Join grids whose lattices are one, larger ones first; what doesn't join stays as it is.

    A part joins if at least three of its corners, and four fifths of those near enough to tell, lie on continued lattice points of the
    other under one turn and shift, colours agree, no label is taken, and validation then drops no more than a tenth of it.
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
    motion = _motion(host, guest)
    if motion is None:
        return None
    moved = {_move(motion, spot): corner for spot, corner in guest.at.items()}
    parity = (-1) ** sum(motion)
    if set(moved) & set(host.at) or board_sign(field, guest) != parity * board_sign(field, host):
        return None
    both = Grid(host.at | moved, host.xy)
    prune(both, field)
    if len(both) < len(host) + 0.9 * len(guest):
        return None
    return both


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
        label = _label_in(host, spots, tree, guest.xy[corner])
        if label is None:
            continue
        voters += 1
        for turns in range(4):
            u, v = _move((turns, 0, 0), spot)
            votes[turns, label[0] - u, label[1] - v] += 1
    if not votes:
        return None
    motion, count = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return motion if count >= max(LEAST_VOTES, SHARE * voters) else None


def _label_in(host: Grid, spots: list[Label], tree: cKDTree, xy: Array) -> Label | None:
    """The host's label for a position just outside it; None if it is too far to say or off the lattice (then counted as no voter)."""
    near = spots[int(tree.query(xy)[1])]
    here = host.predict(near)
    if here is None:
        return None
    step = np.stack([here.du, here.dv], axis=1)
    if abs(np.linalg.det(step)) < 1e-6:
        return None
    offset = np.linalg.solve(step, xy - host.xy[host.at[near]])
    whole = np.rint(offset)
    if np.abs(whole).max() > GAP or np.abs(offset - whole).max() > OFF * max(1.0, np.abs(whole).max() / 1.5):
        return None
    return near[0] + int(whole[0]), near[1] + int(whole[1])
