"""Parts of one board that a shadow, a finger or a glare has torn apart are put together again."""

from __future__ import annotations

from collections import Counter
from functools import cached_property

import numpy as np

from rcdn.boards.graph import Field, Label
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.geometry.matrices import product
from rcdn.geometry.near import nearest
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
    if len(grids) < 2:
        return grids
    left = [_Lattice(grid) for grid in sorted(grids, key=lambda g: (-len(g), min(g.at.values())))]
    out: list[Grid] = []
    while left:
        host = left.pop(0)
        k = 0
        while k < len(left):
            joined = _join(field, host, left[k])
            if joined is None:
                k += 1
            else:
                host = _Lattice(joined)
                left.pop(k)
                k = 0
        out.append(host.grid)
    return out


class _Lattice:
    """A grid with what its neighbours are told by: `labels` (M, 2), positions `xy` (M, 2), and the steps there, `steps` (M, 2, 2), columns du, dv,
    NaN if unknown.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid, self.labels = grid, grid.labels
        self.xy = grid.xy[grid.corners]
        self.steps = grid.predictions(self.labels).maps[:, 2:].reshape(-1, 2, 2).swapaxes(1, 2)
        self._low, self._high = self.xy.min(axis=0).tolist(), self.xy.max(axis=0).tolist()
        self._square = float(np.abs(np.nan_to_num(self.steps)).max(axis=(0, 2)).sum())

    @cached_property
    def squares(self) -> Array:
        """Inverses (M, 2, 2) of the steps, NaN where these span nothing."""
        (a, b), (c, d) = self.steps.transpose(1, 2, 0)
        area = a * d - b * c
        area = np.where(np.abs(area) >= 1e-6, area, np.nan)
        return (np.array([[d, -b], [-c, a]]) / area).transpose(2, 0, 1)

    def apart(self, other: _Lattice) -> bool:
        """Are two grids surely further apart than `GAP` squares of either?"""
        ways = ((self._low, other._high), (other._low, self._high))
        gap = max(a[k] - b[k] for a, b in ways for k in (0, 1))
        return gap > (GAP + 1) * max(self._square, other._square) * 2


def _join(field: Field, host: _Lattice, guest: _Lattice) -> Grid | None:
    if host.apart(guest):
        return None
    motion = _motion(host, guest)
    back = None if motion is None else _motion(guest, host)
    if motion is None or back is None or not _inverse(motion, back):
        return None
    moved = {_move(motion, spot): corner for spot, corner in guest.grid.at.items()}
    parity = (-1) ** sum(motion)
    if set(moved) & set(host.grid.at) or board_sign(field, guest.grid) != parity * board_sign(field, host.grid):
        return None
    return Grid(host.grid.at | moved, host.grid.xy)


def _inverse(motion: Motion, back: Motion) -> bool:
    return all(_move(back, _move(motion, spot)) == spot for spot in ((0, 0), (1, 0), (0, 1)))


def _move(motion: Motion, spot: Label) -> Label:
    u, v = spot
    for _ in range(motion[0]):
        u, v = -v, u
    return u + motion[1], v + motion[2]


def _motion(host: _Lattice, guest: _Lattice) -> Motion | None:
    """The turn and shift that take the guest's labels to the host's, or None if there is no clear one."""
    near = nearest(host.xy, guest.xy)[1][:, 0]
    offset = product(host.squares[near], (guest.xy - host.xy[near])[..., None])[..., 0]
    whole = np.rint(offset)
    reach = np.abs(whole).max(axis=1)
    voters = (reach >= 1) & (reach <= GAP)
    close = np.flatnonzero(voters & (np.abs(offset - whole).max(axis=1) <= OFF * reach))
    if len(close) < max(LEAST_VOTES, SHARE * int(voters.sum())):
        return None  # each has one vote for a motion at most
    alike = _same_steps(host.squares[near[close]], guest.steps[close])
    votes: Counter[Motion] = Counter()
    base = host.labels[near[close]] + whole[close].astype(int)
    for spot, (u, v), turns in zip(guest.labels[close].tolist(), base.tolist(), alike, strict=True):
        for turn in np.flatnonzero(turns).tolist():
            d, e = _move((turn, 0, 0), (spot[0], spot[1]))
            votes[turn, u - d, v - e] += 1
    if not votes:
        return None
    motion, count = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return motion if count >= max(LEAST_VOTES, SHARE * int(voters.sum())) else None


def _same_steps(squares: Array, steps: Array) -> Array:
    """(K, 4) bool: are a guest's `steps` (K, 2, 2), after so many turns, the host's, by its `squares` (K, 2, 2), but for a quarter of a square?"""
    out = []
    for _ in range(4):
        difference = product(squares, steps) - np.eye(2)
        out.append(np.linalg.norm(difference, axis=1).max(axis=1, initial=0) < STRETCH)
        # labels turn by (u, v) -> (-v, u): the step along the new u is the old step along -v
        steps = np.stack([-steps[..., 1], steps[..., 0]], axis=2)
    return np.stack(out, axis=1)
