"""Pictures of coded boards with known corners: drawn flat by their own rules (ChArUco by OpenCV), then tilted, blurred, with noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.targets.puzzle import CODE_1, CODE_2

SQUARE = 96
"""px of the flat drawing"""


@dataclass(frozen=True)
class Drawing:
    """A flat drawing, grey, and its corners: `ids` (N,) and `xy` (N, 2) px."""

    image: np.ndarray
    ids: np.ndarray
    xy: np.ndarray


def charuco(
    columns: int,
    rows: int,
    dictionary: str,
    ratio: float = 0.75,
    legacy: bool = False,
    inverted: bool = False,
    first: int = 0,
) -> Drawing:
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    ids = first + np.arange(columns * rows // 2 + columns * rows % 2)
    board = cv2.aruco.CharucoBoard(
        (columns, rows), SQUARE, SQUARE * ratio, known, ids[: _markers(columns, rows, legacy)]
    )
    board.setLegacyPattern(legacy)
    image = board.generateImage((columns * SQUARE, rows * SQUARE), marginSize=0)
    if inverted:
        image = 255 - image
    image = cv2.copyMakeBorder(
        image, SQUARE // 2, SQUARE // 2, SQUARE // 2, SQUARE // 2, cv2.BORDER_CONSTANT, value=0 if inverted else 255
    )
    j, i = np.mgrid[1:rows, 1:columns].reshape(2, -1)
    xy = np.stack([i, j], axis=1) * SQUARE + SQUARE // 2 - 0.5
    return Drawing(image, np.arange(len(xy)), xy)


def _markers(columns: int, rows: int, legacy: bool) -> int:
    odd = not (legacy and rows % 2 == 0)
    return sum((c + r) % 2 == int(odd) for c in range(columns) for r in range(rows))


def aprilgrid(
    columns: int, rows: int, dictionary: str = "DICT_APRILTAG_36h11", border: int = 2, gap: float = 0.3, first: int = 0
) -> Drawing:
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    side, space = SQUARE * 2, round(SQUARE * 2 * gap)
    step = side + space
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
            image[y : y + side, x : x + side] = cv2.resize(
                np.rot90(tag, 2), (side, side), interpolation=cv2.INTER_NEAREST
            )
    image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    j, i = np.mgrid[0 : 2 * rows, 0 : 2 * columns].reshape(2, -1)  # j upwards
    x = i // 2 * step + i % 2 * side + space + 39.5
    y = (rows - 1 - j // 2) * step + (1 - j % 2) * side + space + 39.5
    return Drawing(image, 2 * columns * j + i, np.stack([x, y], axis=1))


def puzzleboard(columns: int, rows: int, start: tuple[int, int]) -> Drawing:
    """`columns` × `rows` corners, the first of which is at place `start` (column, row) of the code."""
    image = np.zeros((rows + 1, columns + 1), np.uint8)
    image[(np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) + sum(start)) % 2 == 1] = 255
    image = cv2.resize(image, None, fx=SQUARE, fy=SQUARE, interpolation=cv2.INTER_NEAREST)
    for j in range(rows):
        for i in range(columns):
            c, r = start[0] + i, start[1] + j
            corner = np.array([i + 1, j + 1]) * SQUARE
            if i + 1 < columns:
                _dot(image, corner + np.array([SQUARE // 2, 0]), CODE_2[c % 3][r % 167] == "1")
            if j + 1 < rows:
                _dot(image, corner + np.array([0, SQUARE // 2]), CODE_1[r % 3][c % 167] == "1")
    j, i = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    ids = 501 * ((start[1] + j) % 501) + (start[0] + i) % 501
    image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    return Drawing(image, ids, (np.stack([i, j], axis=1) + 1) * SQUARE + 39.5)


def _dot(image: np.ndarray, centre: np.ndarray, white: bool) -> None:
    x, y = (2 * centre - 1).tolist()  # in half pixels: the edge lies between two
    cv2.circle(image, (x * 8, y * 8), SQUARE // 6 * 16, 255 if white else 0, -1, cv2.LINE_AA, 4)


def seen(
    drawing: Drawing, width: int = 640, height: int = 480, turn: float = 0.0, tilt: float = 0.3, size: float = 0.8, blur: float = 0.6,
    noise: float = 2.0, light: float = 1.0, shift: tuple[float, float] = (0, 0), seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The drawing in a picture, turned (radians), tilted (radians), `size` of the picture; and where its corners are, (N, 2) px."""
    h, w = drawing.image.shape
    focal = 1.2 * width
    centre = np.array([[1, 0, -(w - 1) / 2], [0, 1, -(h - 1) / 2], [0, 0, 1]])
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    scale = size * min(width, height) / np.hypot(w, h) * 1.25
    distance = focal / scale
    tilted = np.array([[1, 0, 0], [0, np.cos(tilt), 0], [0, np.sin(tilt) / distance, 1]])
    H = np.diag([focal, focal, 1.0]) @ np.array([[1, 0, 0], [0, 1, 0], [0, 0, distance]]) @ tilted @ turned @ centre
    H = np.array([[1, 0, (width - 1) / 2 + shift[0]], [0, 1, (height - 1) / 2 + shift[1]], [0, 0, 1]]) @ H
    over = 4
    up = np.array([[over, 0, (over - 1) / 2], [0, over, (over - 1) / 2], [0, 0, 1]])
    large = cv2.warpPerspective(
        drawing.image,
        up @ H,
        (width * over, height * over),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=110,
    )
    image = cv2.resize(large, (width, height), interpolation=cv2.INTER_AREA).astype(float)
    image = cv2.GaussianBlur(image, (0, 0), blur) * light
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    at = np.column_stack([drawing.xy, np.ones(len(drawing.xy))]) @ H.T
    return np.clip(np.round(image), 0, 255).astype(np.uint8), at[:, :2] / at[:, 2:]


def numbered(detector, image, drawing, xy):
    """(corners with their right number, with a wrong one, corners that the picture shows)."""
    place = dict(zip(drawing.ids.tolist(), xy, strict=True))
    right = wrong = 0
    for board in detector.boards(image):
        for number, at in zip(() if board.ids is None else board.ids.tolist(), board.xy, strict=board.ids is not None):
            good = number in place and np.linalg.norm(place[number] - at) < 4
            right, wrong = right + good, wrong + (not good)
    height, width = image.shape
    return right, wrong, int(((xy > 2) & (xy < [width - 3, height - 3])).all(axis=1).sum())
