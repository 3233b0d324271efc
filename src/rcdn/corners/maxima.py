"""The candidate peaks of a response map: threshold → NMS → clustering."""

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
"""for a map without any response above the usual level: the least maximum at which peaks are still searched for, and
the threshold as a share of that maximum"""
STANDS_OUT, COMMON = 20.0, 0.01
"""such a maximum counts only if at most the share `COMMON` of the map has responses of at least maximum /
`STANDS_OUT`"""


@dataclass(frozen=True, eq=False)
class Maxima:
    """Peaks of a response map: `xy` (N, 2) px, integers; `score` (N,) falling; `level`: the threshold; `rescued`:
    whether it was lowered."""

    xy: Array
    score: Array
    level: float
    rescued: bool

    def take(self, index: Array) -> Maxima:
        """The peaks at `index` (integers or a boolean mask)."""
        return Maxima(self.xy[index], self.score[index], self.level, self.rescued)

    def strong(self, config: DetectorConfig) -> Bool[Array, " n"]:
        """(N,) bool: the peaks that may start a board."""
        return np.asarray(self.score >= self.level * config.seed)


def find_maxima(
    response: Real[Array, "h w"], config: DetectorConfig, cells: Array | None = None, warnings: Warnings | None = None
) -> Maxima:
    """Threshold → NMS → clustering: the candidate peaks of `response` (H, W).

    `cells` (⌈H/4⌉, ⌈W/4⌉) bool: the cells of 4×4 px outside of which the response is 0; None: it may be non-zero
    anywhere. A warning is added to `warnings` if there are more peaks than can be processed.
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
    """Threshold of a map without any response above the usual level: 0.41 of its maximum if that stands out, else
    +inf."""
    top = float(response.max(initial=0))
    if top > RESCUE and np.count_nonzero(response * STANDS_OUT >= top) <= COMMON * response.size:
        return RESCUE_SHARE * top
    return float("inf")
