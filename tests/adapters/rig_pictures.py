"""Pictures that two known cameras, fixed beside each other, take of one ChArUco board at the same moments."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn import Board, Detector, DetectorConfig
from rcdn.geometry import rotation
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor
from rcdn.types import Charuco, Printed
from rcdn_lab.coded.drawings import charuco_drawing
from rcdn_lab.coded.views import drawing_truth, render_drawing

PRINTED = Printed(Charuco(10, 7, "DICT_4X4_50", 0.75), 0.03)
FOCAL = 520.0, 560.0
BASELINE = 0.18
"""m from the left to the right camera, which looks 6° to the left"""
SIZE = 640, 480
LENS = (-0.2, 0.06, 0.0005, -0.0005)


def scenes(number: int) -> tuple[Scene, Scene]:
    """What both cameras see at a moment, with the whole board in each picture."""
    rng = np.random.default_rng((7, number))
    turn = rotation(np.array([0.0, np.deg2rad(6), 0.0]))
    while True:
        axis = np.append(rng.normal(size=2), 0.0)
        R = rotation(axis / np.linalg.norm(axis) * rng.uniform(0.2, 0.8)) @ rotation([0.0, 0.0, rng.uniform(-0.5, 0.5)])
        z = rng.uniform(14, 22)  # squares
        t = np.array([rng.uniform(-4, 10), rng.uniform(-4, 4), z]) - R @ [4.0, 2.5, 0.0]
        left = _scene(0, number, R, t)
        right = _scene(1, number, turn @ R, turn @ (t - [BASELINE / PRINTED.spacing, 0.0, 0.0]))
        if _whole(left) and _whole(right):
            return left, right


def pictures(count: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Those of the left and of the right camera."""
    drawing = charuco_drawing(10, 7, "DICT_4X4_50")
    taken = [[render_drawing(drawing, scene) for scene in scenes(number)] for number in range(count)]
    return [left for left, _ in taken], [right for _, right in taken]


def boards(count: int) -> tuple[list[list[Board]], list[list[Board]]]:
    """The boards that are found in them, picture by picture."""
    detector = Detector(DetectorConfig(target=PRINTED.target))
    left, right = ([detector.boards(picture) for picture in side] for side in pictures(count))
    return left, right


def _scene(camera: int, number: int, R: np.ndarray, t: np.ndarray) -> Scene:
    board = BoardSpec(9, 6, tuple(cv2.Rodrigues(R)[0].ravel().tolist()), tuple(t.tolist()))
    return Scene(
        *SIZE, FOCAL[camera], (322.0, 236.0), "brown", LENS, (board,), sensor=Sensor(blur=0.7, noise=2.0),
        background=Background("shapes", number), seed=2 * number + camera,
    )  # fmt: skip


def _whole(scene: Scene) -> bool:
    xy = drawing_truth(charuco_drawing(10, 7, "DICT_4X4_50"), scene).xy
    return bool(np.isfinite(xy).all() and (xy > 25).all() and (xy < np.array(SIZE) - 26).all())
