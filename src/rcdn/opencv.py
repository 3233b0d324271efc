"""Drop-in replacements for OpenCV's detectors, with the same shapes of arguments and results."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError, shown
from rcdn.types import Array, Charuco
from rcdn.types.ranges import grid_size

KEPT = 8
"""number of boards whose detectors are cached"""


def find_chessboard_corners(
    image: Any, patternSize: tuple[int, int], corners: object = None, flags: int | None = None
) -> tuple[bool, Array | None]:
    """A drop-in for `cv2.findChessboardCorners(image, patternSize)`: (found, corners (N, 1, 2) float32, row by row).

    `patternSize`: inner corners (columns, rows). `corners` and `flags` are accepted and ignored, so that calls written
    for OpenCV work as they are. The shape is that of OpenCV 4 (OpenCV 5 has (N, 2)). Of boards with one even and one
    odd side the order is OpenCV's; others look the same turned by 180° (or 90°), and may begin at another corner than
    there. The corners are already refined to sub-pixel accuracy. Returns (False, None) if the picture shows no complete
    board of that size. Raises ConfigError for a size under 3×3 and
    ImageError for an unusable image.
    """
    cols, rows = grid_size(patternSize, "patternSize", 3)
    for board in _detector("plain").boards(image):
        grid = board.grid_of((cols, rows)) if board.complete else None
        if grid is not None:
            return True, np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    return False, None


def detect_charuco(image: Any, board: Any, inverted: bool = False) -> tuple[Array | None, Array | None]:
    """A drop-in for `cv2.aruco.CharucoDetector(board).detectBoard(image)[:2]`: (corners (N, 1, 2) float32, ids (N, 1)
    int32), in ascending order of ids.

    The shapes are those of OpenCV 4. `board`: a `cv2.aruco.CharucoBoard`, of which the dictionary, size and ids are
    used, and the legacy flag where the picture leaves that open. `inverted`: black and white are exchanged in print
    (OpenCV's `DetectorParameters.detectInvertedMarker`). The corners are already refined to sub-pixel accuracy; if the
    picture shows several such boards, they are those of the largest. Returns (None, None) if no part of the
    board is identified with certainty; boards of 3 × 3 squares (2 × 2 corners) are not read. Raises ConfigError for
    another type of board, and for one whose markers are not in any of OpenCV's dictionaries or are not numbered
    consecutively; ImageError for an unusable image.
    """
    target = replace(charuco_of(board), inverted=inverted)
    found = [b for b in _detector(target).boards(image) if b.ids is not None]
    if not found:
        return None, None
    ids = np.asarray(found[0].ids)
    order = np.argsort(ids)
    corners = np.ascontiguousarray(found[0].xy[order].reshape(-1, 1, 2), np.float32)
    return corners, ids[order].reshape(-1, 1).astype(np.int32)


def charuco_of(board: Any) -> Charuco:
    """OpenCV's board as a target. Raises ConfigError if it has no equivalent target."""
    if not isinstance(board, cv2.aruco.CharucoBoard):
        raise ConfigError(f"board must be a cv2.aruco.CharucoBoard, not {shown(board)}")
    columns, rows = board.getChessboardSize()
    ids = np.ravel(board.getIds())
    if not np.array_equal(ids, ids[0] + np.arange(len(ids))):
        raise ConfigError("board: its markers must be numbered one after the other, as they are unless ids are given")
    ratio = round(board.getMarkerLength() / board.getSquareLength(), 6)
    name, legacy = _dictionary_of(board.getDictionary(), int(ids[-1])), bool(board.getLegacyPattern())
    return Charuco(columns, rows, name, ratio, int(ids[0]), legacy)


def _dictionary_of(dictionary: Any, highest: int) -> str:
    """Name of OpenCV's dictionary that has the same markers, at least up to number `highest`. Raises ConfigError if
    there is none."""
    from rcdn.targets.families import families

    side = int(dictionary.markerSize)
    bits = [cv2.aruco.Dictionary.getBitsFromByteList(row[None], side) for row in dictionary.bytesList]
    for family in families(side):
        if len(bits) <= len(family) and np.array_equal(bits, family.bits[: len(bits)]):
            return family.smallest(max(highest, len(bits) - 1))
    raise ConfigError("board: its dictionary has other markers than OpenCV's dictionaries, which are what is read")


@lru_cache(maxsize=KEPT)
def _detector(target: Charuco | Literal["plain"]) -> Detector:
    """The detector for this target, created at the first call and cached."""
    return Detector(DetectorConfig(target=target))
