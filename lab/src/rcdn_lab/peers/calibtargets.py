"""calib-targets: chessboards of any size from ChESS corners, with default settings and with a pyramid and its saddle
refiner."""

from __future__ import annotations

from typing import Any

import numpy as np

from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer, not_installed, version_of


def _grid(result: Any) -> Grid:
    xy = np.array([(c.position[0], c.position[1]) for c in result.corners], float).reshape(-1, 2)
    return Grid(xy, np.array([(c.grid.u, c.grid.v) for c in result.corners], int).reshape(-1, 2))


def _load() -> Find:
    import calib_targets

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        return [_grid(r) for r in calib_targets.detect_chessboard_all(np.ascontiguousarray(image))]

    return find


def _load_pyramid() -> Find:
    import calib_targets

    saddle = calib_targets.ChessStrategyConfig(refiner=calib_targets.ChessRefiner.saddle_point())
    config = calib_targets.ChessConfig(
        strategy=calib_targets.DetectionStrategy.chess(saddle), multiscale=calib_targets.MultiscaleConfig.pyramid()
    )

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        found = calib_targets.detect_chessboard_all(np.ascontiguousarray(image), chess_cfg=config)
        return [_grid(r) for r in found]

    return find


def _missing() -> str | None:
    return not_installed("calib_targets")


DEFAULT = Peer("calib-targets", "free", _missing, lambda: version_of("calib-targets"), _load)
PYRAMID = Peer("calib-targets-pyramid", "free", _missing, lambda: version_of("calib-targets"), _load_pyramid)
