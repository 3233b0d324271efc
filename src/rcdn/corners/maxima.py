"""The peaks of a response map that are worth a look: threshold → NMS → clustering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.corners.cluster import cluster_mask
from rcdn.corners.nms import nms
from rcdn.corners.threshold import threshold_value
from rcdn.types import Array, Warnings
from rcdn.types.arrays import Bool, Real

RESCUE, RESCUE_SHARE = 0.15, 0.41
"""least top response of a map without any response above the usual level that is still looked at, and the threshold's share of it"""
STANDS_OUT, COMMON = 20.0, 0.01
"""no more than this share of the map may come within so many times of that top"""


@dataclass(frozen=True, eq=False)
class Maxima:
    """Peaks of a response map: `xy` (N, 2) px, integers; `score` (N,) falling; `level`: the threshold; `rescued`: was it lowered?"""

    xy: Array
    score: Array
    level: float
    rescued: bool

    def take(self, index: Array) -> Maxima:
        """Those at `index` (integers or a boolean mask)."""
        return Maxima(self.xy[index], self.score[index], self.level, self.rescued)

    def strong(self, config: DetectorConfig) -> Bool[Array, " n"]:
        """(N,) bool: which may start a board."""
        return np.asarray(self.score >= self.level * config.seed)


def find_maxima(
    response: Real[Array, "h w"], config: DetectorConfig, cells: Array | None = None, warnings: Warnings | None = None
) -> Maxima:
    """Threshold → NMS → clustering: the peaks of `response` (H, W) that are worth a look.

    `cells` (⌈H/4⌉, ⌈W/4⌉) bool: the cells of 4×4 px outside of which the response is 0; None: it may be anything anywhere. `warnings`
    are told if there are more than can be looked at.
    """
    level = threshold_value(response, config.threshold, cells)
    rescued = config.rescue and not np.isfinite(level)
    if rescued:
        level = _rescue(response)
    xy, score = nms(response, level * config.weak, config.nms, cells=cells, warnings=warnings)
    inside = ((xy >= config.border) & (xy <= np.array(response.shape[::-1]) - 1 - config.border)).all(axis=1)
    xy, score = xy[inside], score[inside]
    if config.cluster is not None:
        keep = cluster_mask(xy, config.cluster)
        xy, score = xy[keep], score[keep]
    return Maxima(xy, score, level, rescued)


def _rescue(response: Array) -> float:
    """Threshold of a map without any response above the usual level: 0.41 of its maximum where that stands out, else +inf."""
    top = float(response.max(initial=0))
    if top > RESCUE and np.count_nonzero(response * STANDS_OUT >= top) <= COMMON * response.size:
        return RESCUE_SHARE * top
    return float("inf")
