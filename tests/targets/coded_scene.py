"""Pictures of coded boards with known corners, as `rcdn_lab.coded.drawings` draws them: tilted, blurred, with noise."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.synthetic import Background, BoardSpec, Scene, Sensor
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn_lab.coded.drawings import SQUARE, Drawing, puzzleboard_drawing
from rcdn_lab.coded.drawings import aprilgrid_drawing as aprilgrid
from rcdn_lab.coded.drawings import charuco_drawing as charuco
from rcdn_lab.coded.views import drawing_truth, render_drawing

__all__ = ["SQUARE", "Drawing", "aprilgrid", "charuco", "numbered", "puzzleboard", "seen"]


def puzzleboard(columns: int, rows: int, start: tuple[int, int]) -> Drawing:
    """`columns` × `rows` corners, the first of which is at place `start` (column, row) of the code."""
    return puzzleboard_drawing(columns, rows, start, (CODE_1, CODE_2))


def seen(
    drawing: Drawing, width: int = 640, height: int = 480, turn: float = 0.0, tilt: float = 0.3, size: float = 0.8,
    blur: float = 0.6, noise: float = 2.0, light: float = 1.0, shift: tuple[float, float] = (0, 0), seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The drawing in a picture, turned (radians), tilted (radians), `size` of the picture;
    and where its corners are, (N, 2) px."""
    h, w = np.array(drawing.image.shape) / drawing.unit
    focal = 1.2 * width
    distance = focal * np.hypot(w, h) / (size * min(width, height) * 1.25)
    R = cv2.Rodrigues(np.array([tilt, 0.0, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    t = [0, 0, distance] - R @ [4.0, 3.0, 0.0]
    board = BoardSpec(9, 7, tuple(cv2.Rodrigues(R)[0].ravel().tolist()), tuple(t.tolist()), black=0.0, white=1.0)
    scene = Scene(
        width, height, focal, ((width - 1) / 2 + shift[0], (height - 1) / 2 + shift[1]), boards=(board,), seed=seed,
        sensor=Sensor(blur=blur, noise=noise, gain=light), background=Background("plain", 1),
    )  # fmt: skip
    return render_drawing(drawing, scene), drawing_truth(drawing, scene).xy


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
