"""Where a corner should be, from its labelled neighbours: a low-order map of a few squares, never of the whole board."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rcdn.boards.graph import Label
from rcdn.types import Array

REACH = 2
"""neighbours up to this many squares away"""
ENOUGH, WIDEST = 6, REACH + 1
"""with fewer of them, one ring more"""
OFFSETS = np.array([(d, e) for e in range(-WIDEST, WIDEST + 1) for d in range(-WIDEST, WIDEST + 1)])
INNER = np.flatnonzero(np.abs(OFFSETS).max(axis=1) <= REACH)
OUTER = np.flatnonzero(np.abs(OFFSETS).max(axis=1) > REACH)
MIDDLE = len(OFFSETS) // 2
"""places in the window of labels around a spot"""


class Grid:
    """A labelled grid over corners: {(u, v): corner} with the positions at hand."""

    def __init__(self, at: dict[Label, int], xy: Array) -> None:
        self.at, self.xy = dict(at), xy

    def __len__(self) -> int:
        return len(self.at)

    def around(self, spots: Array | Sequence[Label], reach: int) -> Array:
        """Corners (K, (2 reach + 1)²) at the labels around `spots` (K, 2), row by row, each spot in the middle; −1 for none."""
        held, spots = (np.array(a, np.int64).reshape(-1, 2) for a in (list(self.at), spots))
        both = np.concatenate([held, spots])
        low = both.min(axis=0, initial=0) - reach
        table = np.full(both.max(axis=0, initial=0) + reach + 1 - low, -1)
        table[tuple((held - low).T)] = list(self.at.values())
        span = np.arange(-reach, reach + 1)
        u, v = (spots - low).T
        return table[u[:, None, None] + span, v[:, None, None] + span[:, None]].reshape(len(spots), len(span) ** 2)

    def predict(self, spot: Label) -> Prediction | None:
        """Where the corner of `spot` should be; None if its neighbours don't span the plane."""
        guess = self.predictions([spot])
        return Prediction(guess.xy[0], guess.du[0], guess.dv[0], int(guess.support[0])) if guess.support[0] else None

    def predictions(self, spots: Sequence[Label], near: Array | None = None) -> Predictions:
        """`predict` of many spots (K); `support` is 0, and the rest NaN, where their neighbours don't span the plane.

        `near`: the corners around them, if they are at hand: `around(spots, WIDEST)`.
        """
        near = self.around(spots, WIDEST) if near is None else near
        there = near >= 0
        there[:, MIDDLE] = False
        few = there[:, INNER].sum(axis=1) < ENOUGH
        there[:, OUTER] &= few[:, None]
        if not there.any():
            nowhere = np.full((len(near), 2), np.nan)
            return Predictions(nowhere, nowhere, nowhere, np.zeros(len(near), int))
        solvers = np.array([_solver(row.tobytes()) for row in there])
        at, du, dv = (solvers @ self.xy.take(near, axis=0, mode="clip")).swapaxes(0, 1)
        return Predictions(at, du, dv, np.where(np.isnan(at[:, 0]), 0, there.sum(axis=1)))


class Predictions(NamedTuple):
    """Predicted corners: `xy` (K, 2) px, the steps `du`, `dv` (K, 2) px to their neighbours, and on how many corners they stand, `support` (K,)."""

    xy: Array
    du: Array
    dv: Array
    support: Array

    @property
    def pitch(self) -> Array:
        """Lengths (K,) of the shorter steps, px."""
        return np.asarray(np.sqrt(np.minimum((self.du**2).sum(axis=1), (self.dv**2).sum(axis=1))))


def _solver_of(near: tuple[Label, ...]) -> Array | None:
    """(3, K): positions of neighbours at offsets `near` → position and steps of the spot, by weighted least squares.

    Bilinear with four neighbours, quadratic along an axis on which they take three places. None if they don't span the plane.
    """
    if len(near) < 3:
        return None
    u, v = np.array(near, float).T
    columns, rows = len(np.unique(u)), len(np.unique(v))
    if min(columns, rows) < 2:
        return None
    terms = [np.ones(len(u)), u, v]
    if len(u) >= 4:
        terms.append(u * v)
    if len(u) >= 6 and columns >= 3:
        terms.append(u * u)
    if len(u) >= 7 and rows >= 3:
        terms.append(v * v)
    weight = 1 / (1 + u * u + v * v)
    basis = np.stack(terms, axis=1) * weight[:, None]
    left, size, right = np.linalg.svd(basis, full_matrices=False)
    if (size > size[0] * max(basis.shape) * np.finfo(float).eps).sum() < 3:
        return None
    inverse = np.divide(1, size, out=np.zeros_like(size), where=size > 1e-6 * size[0])
    return np.asarray(((right.T * inverse) @ left.T * weight)[:3])


@lru_cache(maxsize=4096)
def _solver(there: bytes) -> Array:
    """(3, (2 WIDEST + 1)²): `_solver_of` over the whole window, for the neighbours that are `there`; NaN if they don't span the plane."""
    window = np.frombuffer(there, bool)
    out = np.zeros((3, len(window)))
    solver = _solver_of(tuple(map(tuple, OFFSETS[window].tolist())))
    if solver is None:
        out[:] = np.nan
    else:
        out[:, window] = solver
    return out


class Prediction:
    """A predicted corner: `xy` (2,) px, the steps `du`, `dv` (2,) px to its neighbours, and how many corners it stands on."""

    def __init__(self, xy: Array, du: Array, dv: Array, count: int) -> None:
        self.xy, self.du, self.dv, self.count = xy, du, dv, count

    @property
    def pitch(self) -> float:
        """Length of the shorter step, px."""
        return float(min(np.linalg.norm(self.du), np.linalg.norm(self.dv)))


def parts(spots: Iterable[Label], steps: Iterable[Label]) -> list[set[Label]]:
    """The parts of a grid's labels that `steps` join, the largest first, of equals that with the smallest label."""
    left, out, ways = set(spots), [], list(steps)
    while left:
        stack, part = [min(left)], set()
        while stack:
            u, v = stack.pop()
            if (u, v) not in left:
                continue
            left.discard((u, v))
            part.add((u, v))
            stack += [(u + d, v + e) for d, e in ways]
        out.append(part)
    return sorted(out, key=lambda p: (-len(p), min(p)))
