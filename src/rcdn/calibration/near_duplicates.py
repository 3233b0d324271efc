"""Clusters of views with the same content: views of one picture, or of a board that hardly moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3
from rcdn.types import Array
from rcdn.types.arrays import Real

NEAR = 0.01
"""share of the frame's diagonal: views whose corners have a smaller mean distance are in one cluster; their errors are
correlated"""


def alike(corners: Corners3, image_size: tuple[int, int], picture: Real[Array, " f"]) -> Real[Array, " f"]:
    """(F,) cluster numbers of the frames: frames of one `picture` (F,) are in one cluster, and so are views of a board
    that hardly moved.

    Copies of a picture and the many frames of a slow video contain no more information than one of them. A view joins
    the first cluster whose first view is close to it, so that a board that moves slowly from frame to frame eventually
    begins a new cluster.
    """
    limit = NEAR * float(np.hypot(*image_size))
    seen = _Seen.of(corners, len(picture))
    found: dict[int, int] = {}
    firsts: list[int] = []
    cluster = np.zeros(len(picture), int)
    for f in range(len(picture)):
        number = found.get(int(picture[f]))
        if number is None:
            near = np.flatnonzero(seen.distances(f, firsts) < limit)
            number = int(near[0]) if len(near) else None
        if number is None:
            number = len(firsts)
            firsts.append(f)
        found[int(picture[f])] = number
        cluster[f] = number
    return cluster


@dataclass(frozen=True, eq=False)
class _Seen:
    """`xy` (F, L, 2) px of the L positions on the board in each view, NaN where it has none; `number` (F,) of corners,
    and `at`: for each view the positions that it has."""

    xy: Array
    number: Array
    at: list[Array]

    @classmethod
    def of(cls, corners: Corners3, frames: int) -> _Seen:
        place = np.unique(corners.board.round(6), axis=0, return_inverse=True)[1].ravel()
        xy = np.full((frames, int(place.max(initial=-1)) + 1, 2), np.nan)
        xy[corners.frame, place] = corners.xy
        there = np.isfinite(xy[:, :, 0])
        return cls(xy, there.sum(axis=1), [np.flatnonzero(row) for row in there])

    def distances(self, view: int, others: list[int]) -> Real[Array, " g"]:
        """(G,) mean distance, px, of the corners that a view has in common with each of `others`; infinite where they
        share less than half."""
        mine = self.at[view]
        length = np.linalg.norm(self.xy[others][:, mine] - self.xy[view, mine], axis=2)
        common = np.isfinite(length).sum(axis=1)
        few = 2 * common < np.maximum(np.maximum(self.number[others], len(mine)), 1)
        return np.asarray(np.where(few, np.inf, np.nansum(length, axis=1) / np.maximum(common, 1)))
