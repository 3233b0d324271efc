"""Grids of circles are told from checkerboards: neither is ever taken for the other."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from coded_scene import SQUARE, Drawing, aprilgrid, charuco, puzzleboard, seen

from rcdn import Board, Corners, Detector, DetectorConfig
from rcdn.batch.calibration_runs import _no_board
from rcdn.io import ImageResult
from rcdn.targets.circles import other_pattern
from rcdn.targets.quick_test import sample_corners

DETECTOR = Detector(DetectorConfig(threads=1))


def circles(columns, rows, radius, asymmetric=False, inverted=False):
    """Discs of `radius`, share of the distance of nearest ones; `xy`: their middles."""
    j, i = np.mgrid[0:rows, 0:columns].reshape(2, -1).astype(float)
    step = (
        SQUARE * np.stack([2 * i + j % 2, j], axis=1) / np.sqrt(2) if asymmetric else SQUARE * np.stack([i, j], axis=1)
    )
    xy = np.round(step) + SQUARE
    width, height = (xy.max(axis=0) + SQUARE).astype(int).tolist()
    image = np.full((height, width), 255, np.uint8)
    for x, y in xy.astype(int).tolist():
        cv2.circle(image, (x * 16, y * 16), round(radius * SQUARE * 16), 0, -1, cv2.LINE_AA, 4)
    return Drawing(255 - image if inverted else image, np.arange(len(xy)), xy)


def checkerboard(columns, rows):
    """`columns` × `rows` corners, with a white margin."""
    image = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2 * 255
    image = np.kron(image, np.ones((SQUARE, SQUARE))).astype(np.uint8)
    j, i = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    return Drawing(image, np.arange(len(i)), (np.stack([i, j], axis=1) + 1) * SQUARE + 39.5)


def board_at(xy, columns, image):
    """The board whose corners are those of a drawing in its picture."""
    k = np.arange(len(xy))
    ij, none = np.stack([k % columns, k // columns], axis=1), np.zeros(len(xy))
    return Board(xy, ij, image.shape[::-1], none, none.astype(np.uint8), "ambiguous_90")


@dataclass(frozen=True)
class Camera:
    """What a camera does to a picture after its lens."""

    exposure: float = 1.0
    bloom: float = 0.0
    gamma: float = 1.0
    sharpened: float = 0.0
    cover: bool = False

    def __call__(self, image):
        grey = image.astype(float) * self.exposure
        if self.bloom:
            grey = cv2.GaussianBlur(np.minimum(grey, 400), (0, 0), self.bloom)
        grey = 255 * (np.clip(grey, 0, 255) / 255) ** self.gamma
        grey = grey + self.sharpened * (grey - cv2.GaussianBlur(grey, (0, 0), 2.0))
        if self.cover:
            height, width = grey.shape
            grey[height // 2 :, width // 2 : width * 5 // 8] = 150
        return np.clip(np.round(grey), 0, 255).astype(np.uint8)


CAMERAS = (
    Camera(), Camera(exposure=2.5), Camera(exposure=1.8, bloom=2.0), Camera(gamma=0.45), Camera(gamma=2.2),
    Camera(sharpened=1.5), Camera(sharpened=4.0), Camera(exposure=2.5, sharpened=2.0), Camera(cover=True),
)  # fmt: skip


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize(
    ("asymmetric", "radius"), [(True, 0.25), (True, 0.35), (True, 0.45), (False, 0.35), (False, 0.4)]
)
def test_a_circle_grid_is_no_board_but_told(asymmetric, radius, inverted):
    drawing = circles(*((4, 11) if asymmetric else (9, 7)), radius, asymmetric, inverted)
    count = 0
    for k, scene in enumerate(
        ({}, {"noise": 20}, {"blur": 2.0}, {"size": 0.6}, {"tilt": 0.8, "turn": 1.0}, {"light": 0.3})
    ):
        image, _ = seen(drawing, seed=k, **scene)
        found = DETECTOR.detect(Camera(cover=k == 0)(image))
        assert found.boards == []
        count += any(text.startswith("not supported: a circle grid") for text in found.warnings)
    assert count >= 4  # in the others no lattice of gaps was found to begin with


@pytest.mark.parametrize("asymmetric", [False, True])
def test_a_sharpened_circle_grid_is_none_either(asymmetric):
    """Sharpening draws a rim around each disc, which no model of a disc has."""
    camera, told = Camera(exposure=2.0, sharpened=2.0), 0
    for k, radius in enumerate((0.3, 0.35, 0.4)):
        drawing = circles(*((4, 11) if asymmetric else (9, 7)), radius, asymmetric)
        for blur in (0.6, 1.5):
            image, _ = seen(drawing, seed=k, blur=blur, noise=3, tilt=0.4)
            found = DETECTOR.detect(camera(image))
            assert found.boards == [], (radius, blur)
            told += any(text.startswith("not supported: a circle grid") for text in found.warnings)
    assert told >= 4


@pytest.mark.parametrize("camera", CAMERAS, ids=str)
def test_no_checkerboard_is_taken_for_circles(camera):
    """Whatever blurs it, overexposes it and covers it; with its corners known,
    so that the detector need not find them."""
    rng = np.random.default_rng(20)
    for k, (columns, rows) in enumerate([(9, 6), (3, 3), (14, 11)] * 14):
        image, xy = seen(
            checkerboard(columns, rows), blur=rng.uniform(0.5, 5), noise=rng.choice([2, 20]), tilt=rng.uniform(0, 1),
            turn=rng.uniform(-3, 3), size=rng.uniform(0.4, 0.9), light=rng.choice([0.3, 1.0]), seed=k,
        )  # fmt: skip
        image = camera(image)
        assert not other_pattern(sample_corners(image, board_at(xy, columns, image))), k


@pytest.mark.parametrize("blur", [0.6, 1.5, 3.0])
def test_boards_of_small_squares_are_no_circles(blur):
    for k in range(8):
        image, xy = seen(checkerboard(20, 14), 320, 240, size=0.5 + 0.05 * k, blur=blur, noise=5, seed=k)
        assert not other_pattern(sample_corners(image, board_at(xy, 20, image)))


@pytest.mark.parametrize(
    "drawing",
    [
        charuco(8, 8, "DICT_4X4_50"),
        charuco(6, 5, "DICT_6X6_250", 0.6, inverted=True),
        aprilgrid(4, 3),
        puzzleboard(9, 7, (20, 40)),
    ],
    ids=["charuco", "inverted charuco", "aprilgrid", "puzzleboard"],
)
def test_coded_boards_are_no_circles(drawing):
    for blur in (0.6, 1.5, 3.0):
        found = DETECTOR.detect(seen(drawing, blur=blur)[0])
        assert not any("circle" in text for text in found.warnings)


def test_a_calibration_says_why_there_is_no_board():
    def images(*warnings):
        none = Corners(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.uint8))
        return [ImageResult(f"{k}.png", 640, 480, none, (), texts) for k, texts in enumerate(warnings)]

    circle = "not supported: a circle grid (…)"
    told = _no_board(images((circle,), (circle,), ("of 9 peaks …",)))
    assert told == f"no board was found in 3 pictures; 2 of them: {circle}"
    assert "squares need sharp" in _no_board(images((), ()))


def mesh(pitch, half, turn=0.0, inverted=False):
    """A picture (300, 400) of bars along both diagonals of a lattice of `pitch` px, and holes with the half-diagonal
    `half`, share of the pitch, between them."""
    y, x = np.mgrid[0:1200, 0:1600] / 4
    u, v = (x * np.cos(turn) + y * np.sin(turn)) / pitch, (y * np.cos(turn) - x * np.sin(turn)) / pitch

    def off(t, k):
        return np.abs((t - k + 0.5) % 2 - 1)

    holes = np.minimum(off(u, 0) + off(v, 0), off(u, 1) + off(v, 1)) < half
    grey = cv2.resize(60.0 + 160 * (holes != inverted), (400, 300), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(grey, (0, 0), 0.6).astype(np.uint8)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize(("pitch", "half"), [(10, 0.6), (10, 0.8), (14, 0.6)])
def test_a_mesh_is_no_board(pitch, half, inverted):
    found = DETECTOR.detect(mesh(pitch, half, inverted=inverted))
    assert found.boards == []
    told = [text for text in found.warnings if text.startswith("not supported: ")]
    assert len(told) == 1
    assert told[0].startswith("not supported: a mesh")


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("half", [0.5, 0.7, 0.9])
def test_a_mesh_is_told_from_circles_and_from_a_checkerboard(half, inverted):
    """At the corners of its lattice, which lies along the diagonals of its bars."""
    turn, pitch = 0.2, 14.0
    image = mesh(pitch, half, turn, inverted)
    j, i = np.mgrid[2:10, 8:18].reshape(2, -1)
    x, y = i * pitch * np.cos(turn) - j * pitch * np.sin(turn), i * pitch * np.sin(turn) + j * pitch * np.cos(turn)
    board = board_at(np.stack([x, y], axis=1) - 0.375, 10, image)
    assert other_pattern(sample_corners(image, board)) == "mesh"
