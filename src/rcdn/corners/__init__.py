"""From a response map to corners: threshold, NMS, clustering, refinement, edge orientation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from rcdn.config import DetectorConfig
from rcdn.corners.cluster import cluster_mask
from rcdn.corners.nms import nms
from rcdn.corners.orientation import Orientation, axes
from rcdn.corners.refine import refine
from rcdn.corners.threshold import threshold_value
from rcdn.types import Array, Corners

__all__ = ["Candidates", "find_candidates"]

DEFAULT_PITCH = 20.0
"""px; of a corner that is alone in its picture"""
SAME = 1.5
"""px; refined corners closer than this are one corner"""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Corners of one picture with what the recovery of boards needs to know of them.

    `all` (N): every peak above the weak threshold, `orientation` theirs; `strong` (N,) bool: above the threshold proper.
    """

    all: Corners
    orientation: Orientation
    strong: Array

    @property
    def corners(self) -> Corners:
        """The corners above the threshold, which is what a user gets."""
        return self.all.take(self.strong)


def find_candidates(grey: Array, response: Array, config: DetectorConfig) -> Candidates:
    """Threshold → NMS → clustering → refinement → orientation. `grey` and `response` (H, W)."""
    level = threshold_value(response, config.threshold)
    xy, score = nms(response, level * config.weak, config.nms)
    inside = ((xy >= config.border) & (xy <= np.array(response.shape[::-1]) - 1 - config.border)).all(axis=1)
    xy, score = xy[inside], score[inside]
    strong = score >= level
    if config.cluster is not None:
        keep = np.ones(len(xy), bool)
        keep[strong] = cluster_mask(xy[strong], config.cluster)
        xy, score, strong = xy[keep], score[keep], strong[keep]
    pitch = pitches(xy, strong)
    fine, status = refine(grey, response, xy, config.refine, pitch)
    once = _first_of_each(fine, score)
    found = Corners(fine[once], score[once], status[once])
    strong, pitch = strong[once], pitch[once]
    seen = axes(grey, found.xy, np.clip(0.35 * pitch, 3, 10))
    order = np.lexsort((found.xy[:, 1], found.xy[:, 0], -found.response))
    seen = Orientation(seen.axes[order], seen.contrast[order], seen.polarity[order], seen.fit[order])
    return Candidates(replace(found.take(order), axes=seen.axes), seen, strong[order])


def pitches(xy: Array, strong: Array) -> Array:
    """Distance (N,) from each corner to the nearest strong one, px: about the length of a square's side."""
    if strong.sum() < 2:
        return np.full(len(xy), DEFAULT_PITCH)
    distance = cKDTree(xy[strong]).query(xy, k=2)[0]
    return np.asarray(np.where(distance[:, 0] > 0, distance[:, 0], distance[:, 1]))


def _first_of_each(xy: Array, score: Array) -> Array:
    """Indices, rising, without the weaker of any two corners that came to lie on one spot."""
    keep = np.ones(len(xy), bool)
    for i, j in sorted(cKDTree(xy).query_pairs(SAME)) if len(xy) else []:
        if keep[i] and keep[j]:
            keep[j if score[i] >= score[j] else i] = False
    return np.flatnonzero(keep)
