"""Boards seen by known cameras: exact corners, noise, gross errors, missing parts. For simulations and tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rcdn.geometry import project, rotation
from rcdn.geometry.models import distorted, fold
from rcdn.geometry.order import colour_after, turn_of
from rcdn.geometry.rules import CHECKER
from rcdn.types import Array, Board, Camera

SIZE, SPACING = (9, 6), 0.03
"""columns and rows of inner corners; m"""
WIDE = (640, 480)
CAMERAS = {
    "pinhole": Camera(np.array([[520.0, 0, 330], [0, 515, 236], [0, 0, 1]]), np.zeros(0), WIDE, "pinhole"),
    "brown": Camera(
        np.array([[520.0, 0, 330], [0, 515, 236], [0, 0, 1]]), np.array([-0.28, 0.09, 0.001, -0.0015, -0.02]), WIDE
    ),
    "rational": Camera(
        np.array([[420.0, 0, 330], [0, 415, 236], [0, 0, 1]]),
        np.array([0.35, 0.02, 0.001, -0.0015, 0.0, 0.7, 0.08, 0.0]),
        WIDE,
        "rational",
    ),
    "fisheye": Camera(
        np.array([[250.0, 0, 325], [0, 248, 242], [0, 0, 1]]), np.array([0.04, -0.015, 0.006, -0.001]), WIDE, "fisheye"
    ),
}


def random_camera(model: str, seed: int) -> Camera:
    """The camera of CAMERAS; for `rational` a random one, whose denominator is drawn as widely as the solver's prior
    allows."""
    if model != "rational":
        return CAMERAS[model]
    rng, n = np.random.default_rng(seed), np.linspace(0.01, 1.1, 100)
    axis = np.stack([n, np.zeros_like(n), np.ones_like(n)], axis=1)
    while True:
        lens = np.concatenate(
            [rng.normal(0, 0.5, 2), rng.normal(0, 0.001, 2), rng.normal(0, 0.5, 1), rng.normal(0, 1, 3)]
        )
        camera = Camera(CAMERAS["brown"].K, lens, WIDE, "rational")
        radial = distorted(camera, axis)[:, 0] / n
        if fold(camera) > np.arctan(1.3) and ((radial > 0.3) & (radial < 3)).all():
            return camera


def labels(size: tuple[int, int] = SIZE) -> Array:
    """(N, 2) labels of a whole board, row by row."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)


def random_pose(
    rng: np.random.Generator,
    spread: float = 0.5,
    tilt: float = 0.8,
    distance: tuple[float, float] = (0.3, 0.8),
    size: tuple[int, int] = SIZE,
) -> Array:
    """(4, 4) T_cam_board of a board `distance` m away, up to `spread` off the axis (tangent) and tilted by up to `tilt`
    rad."""
    z = rng.uniform(*distance)
    centre = np.array([*rng.uniform(-spread, spread, 2) * [1, 0.75] * z, z])
    axis = np.append(rng.normal(size=2), 0)
    R = rotation(axis / np.linalg.norm(axis) * rng.uniform(0.2, 1) * tilt) @ rotation(
        np.array([0, 0, rng.uniform(-3, 3)])
    )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, centre - R @ [*(np.array(size) - 1) * SPACING / 2, 0]
    return T


def see(camera: Camera, T: Array, size: tuple[int, int] = SIZE, offsets: Array | None = None) -> tuple[Array, Array]:
    """(N, 2) labels and (N, 2) exact pixels of the corners of a board that project into the picture.

    `offsets` (columns × rows, 3) m: displacements of the corners from their positions on a perfect plane, in the order
    of `labels`.
    """
    ij = labels(size)
    on_board = np.column_stack([ij * SPACING, np.zeros(len(ij))]) + (0.0 if offsets is None else offsets)
    xy = project(camera, on_board @ T[:3, :3].T + T[:3, 3])
    inside = (xy > 1).all(axis=1) & (xy < np.array(camera.image_size) - 2).all(axis=1)
    return ij[inside], xy[inside]


def board(ij: Array, xy: Array, image_size: tuple[int, int], sigma: Array | None = None) -> Board:
    """A board of these corners; its colours determine its labels."""
    return Board(xy, ij, image_size, np.ones(len(xy)), np.zeros(len(xy)), "unique", sigma)


def detected(ij: Array, xy: Array, image_size: tuple[int, int], sigma: Array | None = None) -> Board:
    """The board as a detector labels what it sees of it: relative to the visible part, by its colours or by how it
    lies. The square inside the whole board's (0, 0) is dark."""
    turn = turn_of(ij, xy, -1)
    own = CHECKER.started(CHECKER.turned(ij, turn))
    order = np.lexsort((own[:, 0], own[:, 1]))
    cols, rows = (own.max(axis=0) + 1).tolist()
    return Board(
        xy[order], own[order], image_size, np.ones(len(xy)), np.zeros(len(xy)), CHECKER.orientation(cols, rows),
        None if sigma is None else sigma[order], origin_dark=colour_after(ij, -1, turn) < 0,
    )  # fmt: skip


def random_boards(
    camera: Camera,
    seed: int,
    views: int = 20,
    noise: float = 0.2,
    outliers: float = 0.0,
    whole: bool = False,
    offsets: Array | Callable[[np.random.Generator], Array] | None = None,
    size: tuple[int, int] = SIZE,
    spread: float = 0.5,
    tilt: float = 0.8,
) -> tuple[list[Board], list[Array]]:
    """`views` boards with at least half of their corners in the picture, or all of them if `whole`, and their true
    poses.

    Labels of a part start at its own (0, 0); the pose is that of the whole board. Gaussian `noise` px; a share of
    `outliers` is displaced by 5 to 40 px. `offsets` of the corners, m, as in `see`: of one board, or a function that
    draws them anew for every view.
    """
    rng, bending = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    boards: list[Board] = []
    poses = []
    while len(boards) < views:
        T = random_pose(rng, spread, tilt, size=size)
        ij, xy = see(camera, T, size, offsets(bending) if callable(offsets) else offsets)
        if len(ij) < size[0] * size[1] * (1 if whole else 0.5):
            continue
        xy = xy + rng.normal(0, noise, xy.shape)
        wrong = rng.random(len(xy)) < outliers
        angle = rng.uniform(0, 2 * np.pi, len(xy))
        away = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(5, 40, len(xy))[:, None]
        xy[wrong] += away[wrong]
        boards.append(board(ij - ij.min(axis=0), xy, camera.image_size, np.full(len(xy), noise)))
        poses.append(T)
    return boards, poses
