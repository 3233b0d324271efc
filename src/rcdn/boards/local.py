"""Where a corner should be, from its labelled neighbours: a low-order map of a few squares, never of the whole board."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from rcdn.boards.graph import Label
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

_around = bind("rcdn_grid_around")
_predict = bind("rcdn_grid_predict")
_beside = bind("rcdn_grid_beside")
LEAST_PITCH = 2.0
"""px; smaller squares are none"""
WIDEST = 3
"""squares: labels further away tell a prediction nothing"""
Labels = Array | Sequence[Label]
"""of spots: (K, 2), or so many (u, v)"""


class Grid:
    """A labelled grid over corners: {(u, v): corner} with the positions at hand."""

    def __init__(self, at: dict[Label, int], xy: Array) -> None:
        self.at, self.xy = dict(at), xy

    def __len__(self) -> int:
        return len(self.at)

    @property
    def labels(self) -> Int[Array, "m 2"]:
        """Of its corners, (M, 2) int64, in the order of `at`."""
        return as_labels(self.at)

    @property
    def corners(self) -> Int[Array, " m"]:
        """Their numbers, (M,) int64, in the order of `at`."""
        return np.fromiter(self.at.values(), np.int64, len(self.at))

    def append(self, xy: list[Array], shared: Array) -> None:
        """Put positions (2,) of its own behind `xy`: into the room behind `shared`, those of all corners, if there is some. One grid at a time."""
        before, after, room = len(self.xy), len(self.xy) + len(xy), shared.base
        if room is not None and self.xy.base is room and after <= len(room):
            room[before:after] = np.reshape(xy, (-1, 2))
            self.xy = room[:after]
        elif xy:
            self.xy = np.vstack([self.xy, *xy])

    def around(self, spots: Labels, reach: int) -> Array:
        """Corners (K, (2 reach + 1)²) at the labels around `spots` (K, 2), row by row, each spot in the middle; −1 for none."""
        rows = windows(self.labels, spots, reach)
        return np.where(rows >= 0, self.corners[rows], -1) if self.at else rows

    def predict(self, spot: Label) -> Prediction | None:
        """Where the corner of `spot` should be; None if its neighbours don't span the plane."""
        guess = self.predictions([spot])
        return Prediction(guess.xy[0], guess.du[0], guess.dv[0], int(guess.support[0])) if guess.support[0] else None

    def predictions(self, spots: Labels) -> Predictions:
        """`predict` of many spots (K); `support` is 0, and the rest NaN, where their neighbours don't span the plane.

        Weighted least squares over the neighbours up to two squares away, with fewer than six of them up to three: bilinear with four
        neighbours, quadratic along an axis on which they take three places; the smallest such map where there are many.
        """
        return predictions(self.labels, self.xy[self.corners], as_labels(spots))

    def beside(self) -> tuple[Array, Predictions]:
        """The empty labels (K, 2) beside its corners, where a grid may go on, sorted; and their predictions, of steps of 2 px and more."""
        return beside(self.labels, self.xy[self.corners])


def predictions(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], spots: Int[Array, "k 2"]) -> Predictions:
    """`Grid.predictions` at `spots` (K, 2) of the corners `labels`, `xy` (M, 2)."""
    guess = Predictions.room(len(spots))
    _predict(labels, xy, spots, *guess)
    return guess


def beside(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"]) -> tuple[Array, Predictions]:
    """`Grid.beside` of the corners `labels`, `xy` (M, 2)."""
    room = 4 * len(labels)
    spots, guess = np.empty((room, 2), np.int64), Predictions.room(room)
    count = _beside(labels, xy, LEAST_PITCH, spots, *guess)
    return spots[:count], guess.take(slice(count))


def as_labels(spots: Iterable[Label] | Array) -> Int[Array, "k 2"]:
    """(K, 2) int64 of the labels of spots."""
    if isinstance(spots, np.ndarray):
        return np.ascontiguousarray(spots, np.int64).reshape(-1, 2)
    return np.fromiter(chain.from_iterable(spots), np.int64).reshape(-1, 2)


def windows(labels: Int[Array, "m 2"], spots: Labels, reach: int) -> Array:
    """Rows (K, (2 reach + 1)²) of `labels` (M, 2) around `spots` (K, 2), row by row, each spot in the middle; −1 for none."""
    spots = as_labels(spots)
    out = np.empty((len(spots), (2 * reach + 1) ** 2), np.int64)
    _around(labels, spots, reach, out)
    return out


class Predictions(NamedTuple):
    """Predicted corners and the steps to their neighbours: `maps` (K, 6) px, x, y and both steps; on how many corners they stand, `support` (K,);
    lengths of the shorter steps, `pitch` (K,) px. NaN where `support` is 0.
    """

    maps: Array
    support: Array
    pitch: Array

    @classmethod
    def room(cls, count: int) -> Predictions:
        """For so many, not filled in."""
        return cls(np.empty((count, 6)), np.empty(count, np.int64), np.empty(count))

    def take(self, index: Array | slice) -> Predictions:
        """Those at `index`."""
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


class Prediction:
    """A predicted corner: `xy` (2,) px, the steps `du`, `dv` (2,) px to its neighbours, and how many corners it stands on."""

    def __init__(self, xy: Array, du: Array, dv: Array, count: int) -> None:
        self.xy, self.du, self.dv, self.count = xy, du, dv, count

    @property
    def pitch(self) -> float:
        """Length of the shorter step, px."""
        return float(min(np.linalg.norm(self.du, axis=0), np.linalg.norm(self.dv, axis=0)))


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
