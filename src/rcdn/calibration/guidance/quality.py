"""Blur and exposure of a frame, measured at the edges of the board's squares.

Between two neighbouring corners runs the edge of a black square and a white one: a slanted-edge target (ISO 12233) at
dozens of places. The mean profile across the edges that run along columns, and that across those along rows, give the
blur in both directions; motion blurs one more than the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.types import Array, Board
from rcdn.types.arrays import Real, Shaped

REACH, LONGEST = 0.4, 12.0
"""half length of a profile across an edge: a share of the edge's length, and at most in px"""
SAMPLES = 49
"""number of samples of a profile"""
PLATEAU = 0.2
"""share of a profile at either end that gives the grey levels of the dark and of the bright square"""
LOW, HIGH, NORMAL = 0.2, 0.8, 2 * 0.8416
"""the levels between which an edge's width is measured, and the distance between them in standard deviations of a
Gaussian"""
SATURATED = 254
"""grey level from which a pixel counts as overexposed"""
MOST_EDGES = 60
"""most edges of one direction that are measured"""


@dataclass(frozen=True)
class Quality:
    """Quality of a board's picture: `blur`, standard deviation of the Gaussian that would blur its edges equally, px,
    in the worse of both directions; `contrast` of its squares, grey levels; `clipped`, share of overexposed white
    squares. NaN where there is no edge to measure."""

    blur: float
    contrast: float
    clipped: float


def quality(grey: Shaped[Array, "h w"], board: Board) -> Quality:
    """The quality of `board` in the picture `grey` (H, W) uint8, in whose pixels its corners are given."""
    measured = [_across(grey, *_edges(board, step)) for step in ((1, 0), (0, 1))]
    blurs = [m.blur for m in measured if np.isfinite(m.blur)]
    known = [m for m in measured if np.isfinite(m.contrast)]
    if not known:
        return Quality(float("nan"), float("nan"), float("nan"))
    worst = max(blurs) if blurs else float("nan")
    return Quality(worst, min(m.contrast for m in known), max(m.clipped for m in known))


def _edges(board: Board, step: tuple[int, int]) -> tuple[Array, Array]:
    """(E, 2) and (E, 2) px: the ends of edges between corners that are neighbours in the direction `step`."""
    at = {(int(i), int(j)): k for k, (i, j) in enumerate(board.ij)}
    pairs = [(k, at[i + step[0], j + step[1]]) for (i, j), k in at.items() if (i + step[0], j + step[1]) in at]
    some = pairs[:: -(-len(pairs) // MOST_EDGES)] if pairs else []
    index = np.array(some, int).reshape(-1, 2)
    return board.xy[index[:, 0]], board.xy[index[:, 1]]


def _across(grey: Array, start: Array, end: Real[Array, "e 2"]) -> Quality:
    """The quality from the profiles across the edges from `start` to `end` (E, 2)."""
    if not len(start):
        return Quality(float("nan"), float("nan"), float("nan"))
    length = np.linalg.norm(end - start, axis=1)
    normal = (end - start)[:, ::-1] * [1, -1] / length[:, None]
    reach = float(min(REACH * np.median(length), LONGEST))
    t = np.linspace(-reach, reach, SAMPLES)
    places = ((start + end) / 2)[:, None] + t[:, None] * normal[:, None]
    profiles = cv2.remap(
        grey, places[..., 0].astype(np.float32), places[..., 1].astype(np.float32), cv2.INTER_LINEAR
    ).astype(float)
    few = max(1, round(PLATEAU * SAMPLES))
    low, high = profiles[:, :few].mean(axis=1), profiles[:, -few:].mean(axis=1)
    falling = low > high
    profiles[falling] = profiles[falling, ::-1]
    dark, bright = np.minimum(low, high), np.maximum(low, high)
    contrast = float(np.median(bright - dark))
    clipped = float((bright >= SATURATED).mean())
    span = np.maximum(bright - dark, 1e-6)[:, None]
    mean = np.median((profiles - dark[:, None]) / span, axis=0)
    return Quality(_width(t, mean) / NORMAL, contrast, clipped)


def _width(t: Array, profile: Array) -> float:
    """Distance between the last position at which a rising `profile` at `t` is below LOW and the first at which it
    reaches HIGH."""
    below, above = np.flatnonzero(profile <= LOW), np.flatnonzero(profile >= HIGH)
    if not len(below) or not len(above) or above[-1] <= below[0]:
        return float("nan")
    first = below[below < above[-1]][-1]
    last = above[above > first][0]

    def crossing(a: int, level: float) -> float:
        rise = profile[a + 1] - profile[a]
        share = (level - profile[a]) / rise if rise > 0 else 0.5
        return float(t[a] + share * (t[a + 1] - t[a]))

    return crossing(last - 1, HIGH) - crossing(first, LOW)
