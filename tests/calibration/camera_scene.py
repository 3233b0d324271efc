"""Boards as known cameras see them: exact corners, noise, gross errors, missing parts."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import project, rotation
from rcdn.types import Board, Camera

SIZE, SPACING = (9, 6), 0.03
WIDE = (640, 480)
CAMERAS = {
    "pinhole": Camera([[520.0, 0, 330], [0, 515, 236], [0, 0, 1]], [], WIDE, "pinhole"),
    "brown": Camera([[520.0, 0, 330], [0, 515, 236], [0, 0, 1]], [-0.28, 0.09, 0.001, -0.0015, -0.02], WIDE, "brown"),
    "rational": Camera(
        [[420.0, 0, 330], [0, 415, 236], [0, 0, 1]],
        [0.35, 0.02, 0.001, -0.0015, 0.0, 0.7, 0.08, 0.0],
        WIDE,
        "rational",
    ),
    "fisheye": Camera([[250.0, 0, 325], [0, 248, 242], [0, 0, 1]], [0.04, -0.015, 0.006, -0.001], WIDE, "fisheye"),
}


def labels(size=SIZE):
    """(N, 2) labels of a whole board, row by row."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)


def pose(rng, spread=0.5, tilt=0.8, distance=(0.3, 0.8), size=SIZE):
    """(4, 4) T_cam_board of a board tilted by up to `tilt` rad and up to `spread` off the axis (tangent)."""
    z = rng.uniform(*distance)
    centre = np.array([*rng.uniform(-spread, spread, 2) * [1, 0.75] * z, z])
    axis = np.append(rng.normal(size=2), 0)
    R = rotation(axis / np.linalg.norm(axis) * rng.uniform(0.2, 1) * tilt) @ rotation(
        np.array([0, 0, rng.uniform(-3, 3)])
    )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, centre - R @ [*(np.array(size) - 1) * SPACING / 2, 0]
    return T


def see(camera, T, size=SIZE, warp=(0.0, 0.0)):
    """(N, 2) labels and (N, 2) exact pixels of the corners that fall into the picture."""
    ij = labels(size)
    u = ij / (np.array(size) - 1) * 2 - 1
    z = (1 - u**2) @ np.array(warp)
    points = np.column_stack([ij * SPACING, z]) @ T[:3, :3].T + T[:3, 3]
    xy = project(camera, points)
    w, h = camera.image_size
    seen = np.isfinite(xy).all(axis=1) & (xy > 1).all(axis=1) & (xy < [w - 2, h - 2]).all(axis=1)
    return ij[seen], xy[seen]


def board(ij, xy, image_size, sigma=None, orientation="unique"):
    """A board of these corners."""
    return Board(xy, ij, image_size, np.ones(len(xy)), np.zeros(len(xy)), orientation, sigma)


def scene(camera, seed, views=20, noise=0.2, outliers=0.0, whole=False, warp=(0.0, 0.0), size=SIZE, **where):
    """(boards, their true poses): of `views` boards with at least half of their corners in the picture, or all of them if `whole`.

    Gaussian `noise` px; a share of `outliers` is thrown 5 to 40 px away.
    """
    rng = np.random.default_rng(seed)
    boards, poses = [], []
    while len(boards) < views:
        T = pose(rng, size=size, **where)
        ij, xy = see(camera, T, size, warp)
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
