"""MATE corners without boards: net A of the RCDN paper with the squared loss, with which that paper compares
(docs/peers.md)."""

from __future__ import annotations

from collections.abc import Callable

import cv2

from rcdn import __version__
from rcdn.config import Adaptive, DetectorConfig, Refine, Threshold
from rcdn.corners import find_maxima
from rcdn.corners.refine import refine
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.table_weights import lacking, load_network

WEIGHTS = "tables/mate"
Respond = Callable[[Array], Array]
"""(H, W) grey levels → (H, W) response"""


def mate_corners(respond: Respond, grey: Array, threshold: Threshold | None = None) -> tuple[Array, Array]:
    """Corners `xy` (N, 2) px of `grey` (H, W) uint8 and responses (N,), the strongest first.

    `threshold`: None is the adaptive one of the RCDN paper's Table 3, `Fixed(0.5)` MATE's own. It is followed by the
    paper's suppression and the Gaussian peak of the response (Eq. 4), without clustering.
    """
    config = DetectorConfig.paper(threshold=threshold or Adaptive(), cluster=None)
    response = respond(grey)
    found = find_maxima(response, config)
    xy, _ = refine(grey, response, found.xy, Refine("peak"))
    return xy, found.score


def _missing() -> str | None:
    absent = lacking(WEIGHTS)
    return f"no weights {absent}: train net A with the squared loss" if absent else None


def _load() -> Find:
    cv2.setNumThreads(1)
    model = load_network(WEIGHTS)

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        xy, _ = mate_corners(lambda grey: model(grey, 1), image)
        return [Grid(xy)] if len(xy) else []

    return find


MATE = Peer("mate", "free", _missing, lambda: __version__, _load, raw=True)
