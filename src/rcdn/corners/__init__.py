"""From a response map to corners: threshold, NMS, clustering, refinement, edge orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from rcdn.config import DetectorConfig
from rcdn.corners.cluster import cluster_mask
from rcdn.corners.nms import nms
from rcdn.corners.orientation import Orientation, axes
from rcdn.corners.refine import refine
from rcdn.corners.threshold import threshold_value
from rcdn.types import Array, Corners, Status

__all__ = ["Candidates", "find_candidates"]

DEFAULT_PITCH = 20.0
"""px; of a corner that is alone in its picture"""
RING = 16.0
"""px; largest ring on which edge directions are read; blurred corners need the room"""
SAME = 3.0
"""px; refined corners closer than this are one corner (squares under 5 px are beyond the network)"""


@dataclass(frozen=True, eq=False)
class Candidates:
    """Corners of one picture with what the recovery of boards needs to know of them.

    `all` (N): every peak that may join a board, `orientation` theirs; `sure` (N,) bool: above the threshold, which is what
    a user calls a corner; `seed` (N,) bool: may start a board.
    """

    all: Corners
    orientation: Orientation
    sure: Array
    seed: Array

    @property
    def corners(self) -> Corners:
        """The corners above the threshold."""
        return self.all.take(self.sure)


def find_candidates(grey: Array, response: Array, config: DetectorConfig) -> Candidates:
    """Threshold → NMS → clustering → refinement → orientation. `grey` and `response` (H, W)."""
    level = threshold_value(response, config.threshold)
    rescued = config.rescue and not np.isfinite(level)
    if rescued:
        level = _rescue(response)
    xy, score = nms(response, level * config.weak, config.nms)
    inside = ((xy >= config.border) & (xy <= np.array(response.shape[::-1]) - 1 - config.border)).all(axis=1)
    xy, score = xy[inside], score[inside]
    if config.cluster is not None:
        keep = cluster_mask(xy, config.cluster)
        xy, score = xy[keep], score[keep]
    strong = score >= level * config.seed
    pitch = pitches(xy, strong)
    fine, status = refine(grey, response, xy, config.refine, pitch, strong)
    once = _first_of_each(fine, score)
    fine, score, status, pitch = fine[once], score[once], status[once], pitch[once]
    if rescued:
        status = np.where(status == Status.REFINED, Status.LOW_CONFIDENCE, status)
    order = np.lexsort((fine[:, 1], fine[:, 0], -score))
    fine, score, status, pitch = fine[order], score[order], status[order], pitch[order]
    strong = score >= level * config.seed
    seen = axes(grey, fine, np.clip(0.35 * pitch, 3, RING), strong)
    return Candidates(Corners(fine, score, status, seen.axes), seen, score >= level, strong)


def _rescue(response: Array) -> float:
    """Threshold of a map without any response above the usual level: 0.41 of its maximum where that stands out, else +inf."""
    top = float(response.max(initial=0))
    if top > 0.15 and top > 20 * float(np.percentile(response, 99)):
        return 0.41 * top
    return float("inf")


def pitches(xy: Array, strong: Array) -> Array:
    """Distance (N,) from each corner to the nearest strong one, px: about the length of a square's side."""
    if strong.sum() < 2:
        return np.full(len(xy), DEFAULT_PITCH)
    distance = cKDTree(xy[strong]).query(xy, k=min(4, int(strong.sum())))[0]
    distance = np.where(distance > SAME, distance, np.inf).min(axis=1)
    return np.where(np.isfinite(distance), distance, DEFAULT_PITCH)


def _first_of_each(xy: Array, score: Array) -> Array:
    """Indices, rising, without the weaker of any two corners that came to lie on one spot."""
    keep = np.ones(len(xy), bool)
    pairs = cKDTree(xy).query_pairs(SAME, output_type="ndarray") if len(xy) else np.zeros((0, 2), int)
    strong, weak = np.where((score[pairs[:, 0]] >= score[pairs[:, 1]])[:, None], pairs, pairs[:, ::-1]).T
    for i, j in sorted(zip(strong.tolist(), weak.tolist(), strict=True), key=lambda p: (-score[p[0]], p)):
        if keep[i]:
            keep[j] = False
    return np.flatnonzero(keep)
