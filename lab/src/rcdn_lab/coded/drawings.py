"""Flat drawings of boards with codes, with the number and the position of every corner.

They are independent of `rcdn.targets`, which reads such boards: OpenCV draws the ChArUco boards and the tags, and the
code of a PuzzleBoard is an argument, so that a mistake in our understanding of their conventions is not repeated in the
ground truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.types import Array

SQUARE = 96
"""side of a square in a drawing, px"""
MARGIN = SQUARE // 2
"""margin of paper around the print, px"""
TAG = 2 * SQUARE
"""side of a tag in a drawing, px"""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A flat drawing `image` (H, W) uint8 and its corners: numbers `ids` (N,), positions `xy` (N, 2) in pixels of the
    drawing; `unit`: side of a square or of a tag, px."""

    image: Array
    ids: Array
    xy: Array
    unit: int = SQUARE


def charuco_drawing(
    columns: int,
    rows: int,
    dictionary: str,
    ratio: float = 0.75,
    legacy: bool = False,
    inverted: bool = False,
    first: int = 0,
) -> Drawing:
    """A ChArUco board of `columns` × `rows` squares as drawn by OpenCV; `ratio` of marker to square, number of the
    `first` marker, `inverted` grey levels."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    ids = first + np.arange(marker_count(columns, rows, legacy))
    board = cv2.aruco.CharucoBoard((columns, rows), SQUARE, SQUARE * ratio, known, ids)
    board.setLegacyPattern(legacy)
    image = np.asarray(board.generateImage((columns * SQUARE, rows * SQUARE), marginSize=0))
    image = _on_paper(255 - image if inverted else image, 0 if inverted else 255)
    j, i = np.mgrid[1:rows, 1:columns].reshape(2, -1)
    xy = np.stack([i, j], axis=1) * SQUARE + MARGIN - 0.5
    return Drawing(image, np.arange(len(xy)), xy)


def marker_count(columns: int, rows: int, legacy: bool = False) -> int:
    """Number of markers of a ChArUco board: one in every white square."""
    odd = not (legacy and rows % 2 == 0)
    return (columns * rows + (not odd)) // 2


def aprilgrid_drawing(
    columns: int, rows: int, dictionary: str = "DICT_APRILTAG_36h11", border: int = 2, gap: float = 0.3, first: int = 0
) -> Drawing:
    """Kalibr's AprilGrid of `columns` × `rows` tags with a `border` in bits, a `gap` relative to the side of a tag
    (rounded to px), and the number of the `first` tag.

    Printed tags are rotated by 180° relative to those drawn by OpenCV. Tags and corners are numbered row by row upwards
    from the bottom left.
    """
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    space = round(TAG * gap)
    step = TAG + space
    image = np.full((rows * step + space, columns * step + space), 255, np.uint8)
    for r in range(rows + 1):
        for c in range(columns + 1):
            image[r * step : r * step + space, c * step : c * step + space] = 0
    for r in range(rows):
        for c in range(columns):
            tag = cv2.aruco.generateImageMarker(
                known, first + (rows - 1 - r) * columns + c, known.markerSize + 2 * border, borderBits=border
            )
            y, x = r * step + space, c * step + space
            image[y : y + TAG, x : x + TAG] = cv2.resize(np.rot90(tag, 2), (TAG, TAG), interpolation=cv2.INTER_NEAREST)
    j, i = np.mgrid[0 : 2 * rows, 0 : 2 * columns].reshape(2, -1)  # j upwards
    x = i // 2 * step + i % 2 * TAG + space
    y = (rows - 1 - j // 2) * step + (1 - j % 2) * TAG + space
    return Drawing(_on_paper(image, 255), 2 * columns * j + i, np.stack([x, y], axis=1) + MARGIN - 0.5, TAG)


def puzzleboard_drawing(
    columns: int, rows: int, start: tuple[int, int], codes: tuple[tuple[str, ...], tuple[str, ...]]
) -> Drawing:
    """A part of the PuzzleBoard of `columns` × `rows` corners, the first of which is at the position `start` (column,
    row) of the code.

    `codes`: bits of the vertical and of the horizontal edges, 3 rows of 167 each, as strings of 0 and 1.
    """
    vertical, horizontal = codes
    image = np.zeros((rows + 1, columns + 1), np.uint8)
    image[np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2 == 1 - sum(start) % 2] = 255
    image = np.asarray(cv2.resize(image, None, fx=SQUARE, fy=SQUARE, interpolation=cv2.INTER_NEAREST))
    for j in range(rows):
        for i in range(columns):
            c, r = start[0] + i, start[1] + j
            corner = np.array([i + 1, j + 1]) * SQUARE
            if i + 1 < columns:
                _dot(image, corner + np.array([SQUARE // 2, 0]), horizontal[c % 3][r % 167] == "1")
            if j + 1 < rows:
                _dot(image, corner + np.array([0, SQUARE // 2]), vertical[r % 3][c % 167] == "1")
    row, column = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    ids = 501 * ((start[1] + row) % 501) + (start[0] + column) % 501
    return Drawing(_on_paper(image, 255), ids, (np.stack([column, row], axis=1) + 1) * SQUARE + MARGIN - 0.5)


def _dot(image: Array, centre: Array, white: bool) -> None:
    x, y = (2 * centre - 1).tolist()  # in half pixels, since the edge lies between two pixels
    cv2.circle(image, (x * 8, y * 8), SQUARE // 6 * 16, 255 if white else 0, -1, cv2.LINE_AA, 4)


def _on_paper(image: Array, paper: int) -> Array:
    return np.asarray(cv2.copyMakeBorder(image, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_CONSTANT, value=(paper,)))
