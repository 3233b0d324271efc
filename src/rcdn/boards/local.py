"""Prediction of corners from their labelled neighbours: a low-order map over a few squares, never over the whole
board."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from rcdn.geometry.rules import CHECKER, Label, Rule
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

_around = bind("rcdn_grid_around")
_predict = bind("rcdn_grid_predict")
_beside = bind("rcdn_grid_beside")
LEAST_PITCH = 2.0
"""least pitch of a grid, px"""
WIDEST = 3
"""largest distance of the labels that a prediction uses, squares"""
Labels = Array | Sequence[Label]
"""labels of spots: (K, 2), or a sequence of (u, v)"""


class Grid:
    """A labelled grid over corners, {(u, v): corner}, together with the positions of all corners."""

    def __init__(self, at: dict[Label, int], xy: Array) -> None:
        self.at, self.xy = dict(at), xy

    def __len__(self) -> int:
        return len(self.at)

    @property
    def labels(self) -> Int[Array, "m 2"]:
        """Labels of its corners, (M, 2) int64, in the order of `at`."""
        return as_labels(self.at)

    @property
    def corners(self) -> Int[Array, " m"]:
        """Indices of its corners, (M,) int64, in the order of `at`."""
        return np.fromiter(self.at.values(), np.int64, len(self.at))

    def append(self, xy: list[Array], shared: Array) -> None:
        """Append positions (2,) of new corners to `xy`.

        They are written into the spare capacity behind `shared`, the positions of all corners, if there is enough;
        otherwise `xy` is copied. Only one grid at a time may use that capacity.
        """
        before, after, room = len(self.xy), len(self.xy) + len(xy), shared.base
        if room is not None and self.xy.base is room and after <= len(room):
            room[before:after] = np.reshape(xy, (-1, 2))
            self.xy = room[:after]
        elif xy:
            self.xy = np.vstack([self.xy, *xy])

    def around(self, spots: Labels, reach: int) -> Array:
        """Corners (K, (2 reach + 1)²) at the labels around `spots` (K, 2), row by row, spot in the centre; −1 for
        none."""
        rows = windows(self.labels, spots, reach)
        return np.where(rows >= 0, self.corners[rows], -1) if self.at else rows

    def predictions(self, spots: Labels) -> Predictions:
        """Predicted corners of spots (K); where their neighbours do not span the plane, `support` is 0 and the rest is
        NaN.

        Weighted least squares over the neighbours up to two squares away, or up to three if there are fewer than six:
        bilinear with four neighbours, quadratic along an axis with three distinct coordinates; among many neighbours
        the smallest such map.
        """
        return predictions(self.labels, self.xy[self.corners], as_labels(spots))

    def beside(self) -> tuple[Array, Predictions]:
        """The empty labels (K, 2) beside its corners, sorted, and their predictions; only those with steps of at least
        2 px."""
        return beside(self.labels, self.xy[self.corners])


def predictions(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], spots: Int[Array, "k 2"]) -> Predictions:
    """`Grid.predictions` at `spots` (K, 2) from corners with `labels`, `xy` (M, 2)."""
    guess = Predictions.room(len(spots))
    _predict(labels, xy, spots, *guess)
    return guess


def beside(
    labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], added: Int[Array, "a 2"] | None = None
) -> tuple[Array, Predictions]:
    """`Grid.beside` for corners with `labels`, `xy` (M, 2); only spots whose prediction may use one of the corners with
    labels `added` (A, 2), if there are any."""
    room = 4 * len(labels)
    spots, guess = np.empty((room, 2), np.int64), Predictions.room(room)
    added = np.empty((0, 2), np.int64) if added is None else added
    count = _beside(labels, xy, added, 2 * WIDEST**2, LEAST_PITCH, spots, *guess)
    return spots[:count], guess.take(slice(count))


def as_labels(spots: Iterable[Label] | Array) -> Int[Array, "k 2"]:
    """Labels of spots as (K, 2) int64."""
    if isinstance(spots, np.ndarray):
        return np.ascontiguousarray(spots, np.int64).reshape(-1, 2)
    return np.fromiter(chain.from_iterable(spots), np.int64).reshape(-1, 2)


def windows(labels: Int[Array, "m 2"], spots: Labels, reach: int) -> Array:
    """Rows (K, (2 reach + 1)²) of `labels` (M, 2) around `spots` (K, 2), row by row, spot in the centre; −1 for
    none."""
    spots = as_labels(spots)
    out = np.empty((len(spots), (2 * reach + 1) ** 2), np.int64)
    _around(labels, spots, reach, out)
    return out


def at_steps(labels: Int[Array, "m 2"], spots: Labels, steps: Sequence[Label]) -> Int[Array, "k s"]:
    """Rows (K, S) of `labels` (M, 2) that are `steps`, each within one label along both axes, from `spots` (K, 2); −1
    for none."""
    return np.asarray(windows(labels, spots, 1)[:, [3 * e + d + 4 for d, e in steps]])


def cell_count(grid: Grid, rule: Rule = CHECKER) -> int:
    """Number of complete cells of a grid."""
    labels = grid.labels
    return sum(int((at_steps(labels, labels, ring) >= 0).all(axis=1).sum()) for ring in rule.cells)


def spots_beside(at: Mapping[Label, int], steps: Iterable[Label]) -> list[Label]:
    """The empty labels that are one of `steps` from a corner of a grid, in order."""
    return sorted({(u + d, v + e) for u, v in at for d, e in steps} - at.keys())


Offer = tuple[float, Label, int]
"""a corner offered to a spot: its distance from the prediction, in squares; the spot; the corner"""


def assign(at: dict[Label, int], free: Bool[Array, " n"], offers: Iterable[Offer]) -> dict[Label, int]:
    """Give offered corners to their spots, in place, nearest to the prediction first; each spot and each corner once.

    `free` (N,) bool: corners that may be taken, updated. Returns what was added.
    """
    new: dict[Label, int] = {}
    for _, spot, corner in sorted(offers):
        if spot not in at and free[corner]:
            at[spot] = new[spot] = corner
            free[corner] = False
    return new


class Predictions(NamedTuple):
    """Predicted corners and the steps to their neighbours.

    `maps` (K, 6) px: x, y and both steps; `support` (K,): number of corners used; `pitch` (K,) px: length of the
    shorter step. NaN where `support` is 0.
    """

    maps: Array
    support: Array
    pitch: Array

    @classmethod
    def room(cls, count: int) -> Predictions:
        """Uninitialised arrays for `count` predictions."""
        return cls(np.empty((count, 6)), np.empty(count, np.int64), np.empty(count))

    def take(self, index: Array | slice) -> Predictions:
        """The predictions at `index`."""
        return Predictions(self.maps[index], self.support[index], self.pitch[index])

    @property
    def xy(self) -> Real[Array, "k 2"]:
        """Positions (K, 2) px."""
        return self.maps[:, :2]

    @property
    def du(self) -> Real[Array, "k 2"]:
        """Steps (K, 2) px along u."""
        return self.maps[:, 2:4]

    @property
    def dv(self) -> Real[Array, "k 2"]:
        """Steps (K, 2) px along v."""
        return self.maps[:, 4:]


def parts(spots: Iterable[Label], steps: Iterable[Label]) -> list[set[Label]]:
    """Components of a grid's labels connected by `steps`, the largest first; of equal ones that with the smallest
    label."""
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
