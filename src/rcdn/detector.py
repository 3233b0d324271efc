"""Image → response → Corners → Boards. Wiring only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.boards import find_boards
from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, find_candidates
from rcdn.corners.response import load_model
from rcdn.errors import ConfigError
from rcdn.io import as_grey
from rcdn.types import Array, Board, Corners


@dataclass(frozen=True, eq=False)
class Detection:
    """What one picture holds: `corners`, every X-corner above the threshold or in a board; `boards`, the grids, largest first."""

    corners: Corners
    boards: list[Board]


class Detector:
    """Finds X-corners and boards. Nobody has to say a board's size.

    `config`: see `DetectorConfig`; default: the preset `auto`. Images: (H, W) grey or (H, W, 3) BGR, 8 or 16 bit or float
    (docs/conventions.md). Bad input raises RcdnError; a picture without a board gives [] and no error. A detector may be used for
    any number of pictures; the same picture always gives the same bytes, whatever `config.threads`.
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self.config = config or DetectorConfig()
        self._model = load_model(self.config.model)

    def response(self, image: Any) -> Array:
        """Response map (H, W) float32, ≥ 0: how much each pixel looks like an X-corner."""
        return self._model(as_grey(image), self.config.threads)

    def corners(self, image: Any) -> Corners:
        """X-corners at sub-pixel positions, by falling response."""
        return self._candidates(as_grey(image)).corners

    def boards(self, image: Any) -> list[Board]:
        """Recovered boards, the one with most corners first; [] if there is none."""
        return self.detect(image).boards

    def detect(self, image: Any) -> Detection:
        """Corners and boards of one picture at the cost of one."""
        grey = as_grey(image)
        found = self._candidates(grey)
        boards = find_boards(grey, found, self.config.min_corners)
        return Detection(_with_members(found, boards), boards)

    def _candidates(self, grey: Array) -> Candidates:
        return find_candidates(grey, self._model(grey, self.config.threads), self.config)


def _with_members(found: Candidates, boards: list[Board]) -> Corners:
    """The corners above the threshold and those below it that are in a board."""
    member = {(x, y): status for b in boards for (x, y), status in zip(b.xy.tolist(), b.status.tolist(), strict=True)}
    spots = [(x, y) for x, y in found.all.xy.tolist()]
    status = np.array([member.get(s, own) for s, own in zip(spots, found.all.status.tolist(), strict=True)], np.uint8)
    keep = found.sure | np.array([s in member for s in spots], bool)
    return replace(found.all, status=status).take(keep)


def find_chessboard_corners(image: Any, pattern_size: tuple[int, int]) -> tuple[bool, Array | None]:
    """A drop-in for `cv2.findChessboardCorners(image, pattern_size)`: (found, corners (N, 1, 2) float32, row by row).

    `pattern_size`: inner corners (columns, rows). The corners are sub-pixel already. (False, None) where no complete board of that size
    is in the picture. Raises ConfigError for a size under 3×3 and ImageError for an unusable image.
    """
    cols, rows = (int(v) for v in pattern_size)
    if min(cols, rows) < 3:
        raise ConfigError(
            f"pattern_size counts inner corners (columns, rows), at least 3 each, not {tuple(pattern_size)}"
        )
    for board in _shared_detector().boards(image):
        grid = board.grid_of((cols, rows)) if board.complete else None
        if grid is not None:
            return True, np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    return False, None


_shared: list[Detector] = []


def _shared_detector() -> Detector:
    """One detector for all calls, made at the first."""
    if not _shared:
        _shared.append(Detector())
    return _shared[0]
