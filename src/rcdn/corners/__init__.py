"""From a response map to corners: threshold, NMS, clustering, refinement, edge orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.corners.maxima import Maxima, find_maxima
from rcdn.corners.orientation import Orientation
from rcdn.corners.patches import plain
from rcdn.corners.peaks import SAME, Peaks, axes_of, nearest_other
from rcdn.corners.refine import refine
from rcdn.geometry.near import pairs
from rcdn.types import Array, Corners, Status
from rcdn.types.arrays import Real, Shaped

__all__ = ["Candidates", "Maxima", "candidates_at", "find_candidates", "find_maxima"]


@dataclass(frozen=True, eq=False)
class Candidates:
    """The corners of one picture, with the data that board recovery needs.

    `all` (N): every peak that may start a board or is a corner by itself; `orientation`: their edge directions; `sure`
    (N,) bool: above the threshold, which makes a peak a corner in the results; `seed` (N,) bool: may start a board;
    `peaks`: weaker peaks, not refined yet, that a growing board may include.
    """

    all: Corners
    orientation: Orientation
    sure: Array
    seed: Array
    peaks: Peaks | None = None

    @property
    def corners(self) -> Corners:
        """The corners above the threshold."""
        return self.all.take(self.sure)


def find_candidates(grey: Shaped[Array, "h w"], response: Real[Array, "h w"], config: DetectorConfig) -> Candidates:
    """Threshold → NMS → clustering → refinement → orientation. `grey` and `response` (H, W)."""
    return candidates_at(grey, response, find_maxima(response, config), config)


def candidates_at(grey: Array, response: Array, found: Maxima, config: DetectorConfig) -> Candidates:
    """Refinement → orientation of the strong peaks; the weak ones are refined only when a board needs them."""
    grey, strong = plain(grey), found.strong(config)
    weak = Peaks(found.xy[~strong], found.score[~strong], found.xy[strong], grey, response, config.refine)
    score, pitch = found.score[strong], nearest_other(weak.strong, weak.strong)
    fine, status = refine(grey, response, weak.strong, config.refine, pitch)
    once = first_of_each(fine, score)
    if found.rescued:
        status = np.where(status == Status.REFINED, Status.LOW_CONFIDENCE, status)
    order = once[np.lexsort((fine[once, 1], fine[once, 0], -score[once]))]
    fine, score, status = fine[order], score[order], status[order]
    seen = axes_of(grey, fine, pitch[order])
    return Candidates(Corners(fine, score, status, seen.axes), seen, score >= found.level, strong[strong][order], weak)


def first_of_each(xy: Array, score: Array) -> Array:
    """Indices, rising, of the corners that remain when the weaker of any two with the same refined position is
    removed."""
    close = pairs(xy, SAME)
    if not len(close):
        return np.arange(len(xy))
    keep = np.ones(len(xy), bool)
    strong, weak = np.where((score[close[:, 0]] >= score[close[:, 1]])[:, None], close, close[:, ::-1]).T
    for i, j in sorted(zip(strong.tolist(), weak.tolist(), strict=True), key=lambda p: (-score[p[0]], p)):
        if keep[i]:
            keep[j] = False
    return np.flatnonzero(keep)
