"""Where a corner should be, from its labelled neighbours: a low-order map of a few squares, never of the whole board."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.boards.graph import Label
from rcdn.types import Array

REACH = 2
"""neighbours up to this many squares away"""


class Grid:
    """A labelled grid over corners: {(u, v): corner} with the positions at hand."""

    def __init__(self, at: dict[Label, int], xy: Array) -> None:
        self.at, self.xy = dict(at), xy

    def __len__(self) -> int:
        return len(self.at)

    def support(self, spot: Label) -> tuple[tuple[Label, ...], Array]:
        """Offsets (K) from `spot` and positions (K, 2) of its labelled neighbours, itself left out; one ring more if they are few."""
        u, v = spot
        for ring in _RINGS:
            near = tuple((d, e) for d, e in ring if (u + d, v + e) in self.at)
            if len(near) >= 6:
                break
        return near, self.xy[[self.at[u + d, v + e] for d, e in near]]

    def neighbours(self, spot: Label) -> list[int]:
        """Labelled corners up to two squares from `spot`, itself left out."""
        span = range(-REACH, REACH + 1)
        return [self.at[s] for e in span for d in span if (d or e) and (s := (spot[0] + d, spot[1] + e)) in self.at]

    def predict(self, spot: Label) -> Prediction | None:
        """Where the corner of `spot` should be; None if its neighbours don't span the plane."""
        near, xy = self.support(spot)
        solver = _solver(near)
        if solver is None:
            return None
        at, du, dv = solver @ xy
        return Prediction(at, du, dv, len(near))


def _ring(reach: int) -> tuple[Label, ...]:
    span = range(-reach, reach + 1)
    return tuple((d, e) for e in span for d in span if d or e)


_RINGS = (_ring(REACH), _ring(REACH + 1))


@lru_cache(maxsize=4096)
def _solver(near: tuple[Label, ...]) -> Array | None:
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
    if np.linalg.matrix_rank(basis) < 3:
        return None
    return np.asarray((np.linalg.pinv(basis, rcond=1e-6) * weight)[:3])


class Prediction:
    """A predicted corner: `xy` (2,) px, the steps `du`, `dv` (2,) px to its neighbours, and how many corners it stands on."""

    def __init__(self, xy: Array, du: Array, dv: Array, count: int) -> None:
        self.xy, self.du, self.dv, self.count = xy, du, dv, count

    @property
    def pitch(self) -> float:
        """Length of the shorter step, px."""
        return float(min(np.linalg.norm(self.du), np.linalg.norm(self.dv)))
