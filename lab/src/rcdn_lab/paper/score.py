"""From response maps to corners under each rule, and from corners to precision and recall, by both definitions."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from rcdn.config import Adaptive, DetectorConfig, Fixed, MaxFraction, Std, Threshold
from rcdn.corners import find_maxima
from rcdn.corners.patches import gather_zero
from rcdn.metrics import counted, match, within_radius
from rcdn.types import Array
from rcdn_lab.paper.networks import Network
from rcdn_lab.peers.chess import WINDOW
from rcdn_lab.peers.maxima import local_maxima

RADIUS = 4.0
"""px; a detection closer than that to a true corner is true (section 4.1)"""
BORDER = 7.0
"""px; detections closer than that to the frame are removed, as in the preset `paper`"""
CHESS = {"Mesa": 0.0, "uEye": 0.6, "GoPro": 0.45}
"""data set → ChESS' threshold (section 4.1), interpreted as a share of the largest response"""


def rules(network: Network) -> dict[str, Threshold]:
    """The threshold rules of Table 2, tuned for a network's loss, by their name in `published`."""
    return {
        "0.5": Fixed(0.5), "std": Std(network.std_factor), "max": MaxFraction(network.max_fraction),
        "adaptive": Adaptive(),
    }  # fmt: skip


def detections(response: Array, rule: Threshold) -> Array:
    """Pixels (N, 2) that the preset `paper` accepts as corners in a response map (H, W): threshold, NMS, border,
    clustering; no refinement."""
    return find_maxima(response, DetectorConfig.paper(threshold=rule)).xy


def chess_detections(response: Array, fraction: float) -> Array:
    """Pixels (N, 2) that ChESS accepts as corners: positive, at least `fraction` of the maximum, the largest of their
    5×5 px, not isolated.

    As `rcdn_lab.peers.chess`, but without refinement. The border rule is the same for all detectors; clustering is not
    part of ChESS.
    """
    xy = local_maxima(response, WINDOW, fraction * float(response.max(initial=0)))
    xy = xy[(gather_zero(response, xy, 1) > 0).sum(axis=(1, 2)) > 1]
    inside = ((xy >= BORDER) & (xy <= np.array(response.shape[::-1]) - 1 - BORDER)).all(axis=1)
    return xy[inside]


@dataclass(frozen=True)
class Counts:
    """Counts over some pictures.

    `found`: detections; `near`: those with a true corner closer than 4 px, `reached`: true corners with a detection
    that close (the paper's definition: a second detection of one corner is true as well); `pairs`: one to one.
    `precisions`, `recalls`: sums over the pictures, by the paper's definition; a picture without detections has
    precision 0.
    """

    pictures: int = 0
    corners: int = 0
    found: int = 0
    near: int = 0
    reached: int = 0
    pairs: int = 0
    precisions: float = 0.0
    recalls: float = 0.0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def rates(self) -> tuple[float, float]:
        """Precision and recall of all detections together, by the paper's definition; 0 if there are none."""
        return self.near / max(self.found, 1), self.reached / max(self.corners, 1)

    @property
    def strict(self) -> tuple[float, float]:
        """Precision and recall, one to one."""
        return self.pairs / max(self.found, 1), self.pairs / max(self.corners, 1)


def count(found: Array, xy: Array, ignore: Array) -> Counts:
    """Counts of one picture: detections (N, 2) compared with true corners `xy` (M, 2) and positions (K, 2) that are
    neither demanded nor forbidden."""
    found = counted(found, xy, ignore, RADIUS, RADIUS)
    near, reached = int(within_radius(found, xy, RADIUS).sum()), int(within_radius(xy, found, RADIUS).sum())
    pairs = len(match(found, xy, RADIUS)[0])
    return Counts(1, len(xy), len(found), near, reached, pairs, near / max(len(found), 1), reached / max(len(xy), 1))
