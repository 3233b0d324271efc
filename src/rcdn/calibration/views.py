"""Clusters of views with the same content: views of one picture, or of a board that hardly moved."""

from __future__ import annotations

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
    places = [_places(corners, f) for f in range(len(picture))]
    found: dict[int, int] = {}
    firsts: list[int] = []
    cluster = np.zeros(len(picture), int)
    for f, place in enumerate(places):
        number = found.get(int(picture[f]))
        if number is None:
            number = next((k for k, g in enumerate(firsts) if _distance(place, places[g]) < limit), None)
        if number is None:
            number = len(firsts)
            firsts.append(f)
        found[int(picture[f])] = number
        cluster[f] = number
    return cluster


def _places(corners: Corners3, frame: int) -> dict[tuple[float, float], Array]:
    """Pixels by position on the board."""
    mine = np.flatnonzero(corners.frame == frame)
    return {
        (round(x, 6), round(y, 6)): corners.xy[k] for k, (x, y) in zip(mine, corners.board[mine].tolist(), strict=True)
    }


def _distance(a: dict[tuple[float, float], Array], b: dict[tuple[float, float], Array]) -> float:
    """Mean distance of the corners in both views, px; infinite if they share less than half."""
    common = a.keys() & b.keys()
    if 2 * len(common) < max(len(a), len(b), 1):
        return float("inf")
    return float(np.mean([np.linalg.norm(a[k] - b[k]) for k in common]))
