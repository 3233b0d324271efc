"""Where a corner should be, from its labelled neighbours: a low-order map of a few squares, never of the whole board."""

from __future__ import annotations

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

    def support(self, spot: Label) -> tuple[Array, Array]:
        """Offsets (K, 2) from `spot` and positions (K, 2) of its labelled neighbours, itself left out; one ring more if they are few."""
        for reach in (REACH, REACH + 1):
            span = range(-reach, reach + 1)
            near = [(d, e) for e in span for d in span if (d or e) and (spot[0] + d, spot[1] + e) in self.at]
            if len(near) >= 6:
                break
        index = [self.at[spot[0] + d, spot[1] + e] for d, e in near]
        return np.array(near, float).reshape(-1, 2), self.xy[index]

    def neighbours(self, spot: Label) -> list[int]:
        """Labelled corners up to two squares from `spot`, itself left out."""
        span = range(-REACH, REACH + 1)
        return [self.at[s] for e in span for d in span if (d or e) and (s := (spot[0] + d, spot[1] + e)) in self.at]

    def predict(self, spot: Label) -> Prediction | None:
        """Where the corner of `spot` should be; None if its neighbours don't span the plane."""
        offset, xy = self.support(spot)
        if len(offset) < 3:
            return None
        u, v = offset.T
        terms = [np.ones(len(u)), u, v]
        columns, rows = len(np.unique(u)), len(np.unique(v))
        if min(columns, rows) < 2:
            return None
        if len(u) >= 4:
            terms.append(u * v)
        if len(u) >= 6 and columns >= 3:
            terms.append(u * u)
        if len(u) >= 7 and rows >= 3:
            terms.append(v * v)
        basis = np.stack(terms, axis=1)
        weight = 1 / (1 + (offset**2).sum(axis=1))
        solution, _, rank, _ = np.linalg.lstsq(basis * weight[:, None], xy * weight[:, None], rcond=1e-6)
        if rank < 3:
            return None
        return Prediction(solution[0], solution[1], solution[2], len(u))


class Prediction:
    """A predicted corner: `xy` (2,) px, the steps `du`, `dv` (2,) px to its neighbours, and how many corners it stands on."""

    def __init__(self, xy: Array, du: Array, dv: Array, count: int) -> None:
        self.xy, self.du, self.dv, self.count = xy, du, dv, count

    @property
    def pitch(self) -> float:
        """Length of the shorter step, px."""
        return float(min(np.linalg.norm(self.du), np.linalg.norm(self.dv)))
