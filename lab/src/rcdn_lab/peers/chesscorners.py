"""chess-corners: ChESS corners without boards."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer, not_installed, version_of


def _load() -> Find:
    import chess_corners

    detector = chess_corners.Detector(chess_corners.DetectorConfig())

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        xy = np.array(detector.detect(np.ascontiguousarray(image)).xy, float).reshape(-1, 2)
        return [Grid(xy)] if len(xy) else []

    return find


CORNERS = Peer(
    "chess-corners",
    "free",
    lambda: not_installed("chess_corners"),
    lambda: version_of("chess-corners"),
    _load,
    raw=True,
)
