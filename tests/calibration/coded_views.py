"""Boards with codes as known cameras see them: exact corners at their places on the target, noise, parts."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import project, rotation
from rcdn.types import AprilGrid, Board, Camera, Charuco, Plane, PuzzleBoard
from rcdn_lab.camera_scenes import WIDE

CHARUCO = Charuco(9, 7, "DICT_4X4_50", 0.75)
APRILGRID = AprilGrid(5, 4, "tag36h11", 0.3)
NOISE = 0.1


def all_places(target):
    """(N, 2) labels of a whole target; of a PuzzleBoard, of a part of 12 × 9 corners at an arbitrary place."""
    if isinstance(target, PuzzleBoard):
        low, high = (231, 77), (243, 86)
    elif isinstance(target, AprilGrid):
        low, high = (0, 0), (2 * target.columns, 2 * target.rows)
    else:
        low, high = (0, 0), (target.columns - 1, target.rows - 1)
    return np.stack(np.meshgrid(*map(np.arange, low, high)), axis=-1).reshape(-1, 2)


def plane_of(target):
    return Plane("aprilgrid", target.gap) if isinstance(target, AprilGrid) else Plane()


def places(target, ij, spacing):
    """(N, 3) m."""
    return np.column_stack([plane_of(target).points(ij) * spacing, np.zeros(len(ij))])


def coded_board(target, ij, xy, image_size=WIDE, noise=NOISE):
    pattern = "aprilgrid" if isinstance(target, AprilGrid) else "checker"
    return Board(
        xy,
        ij,
        image_size,
        np.ones(len(xy)),
        np.zeros(len(xy)),
        "unique",
        np.full(len(xy), noise),
        pattern,
        target,
        target.ids(ij),
    )


def seen_part(rng, camera: Camera, T, target, spacing, share, noise=NOISE):
    """The board before `camera` at T_cam_board, of which a band of about `share` of the columns or rows is kept; None
    if little is in the picture."""
    ij = all_places(target)
    if share < 1:
        axis = int(rng.integers(2))
        low, high = ij[:, axis].min(), ij[:, axis].max() + 1
        width = max(3, round((high - low) * share))
        first = int(rng.integers(low, high - width + 1))
        ij = ij[(ij[:, axis] >= first) & (ij[:, axis] < first + width)]
    p = places(target, ij, spacing) @ T[:3, :3].T + T[:3, 3]
    xy = project(camera, p)
    inside = (xy > 1).all(axis=1) & (xy < np.array(camera.image_size) - 2).all(axis=1)
    if inside.sum() < 12:
        return None
    xy = xy[inside] + rng.normal(0, noise, (int(inside.sum()), 2))
    return coded_board(target, ij[inside], xy, camera.image_size, noise)


def pose_before(rng, target, spacing, distance=(0.3, 0.7), spread=0.4, tilt=0.8):
    """A random T_cam_board whose board's middle is near the axis."""
    z = rng.uniform(*distance)
    axis = np.append(rng.normal(size=2), 0)
    R = rotation(axis / np.linalg.norm(axis) * rng.uniform(0.2, 1) * tilt) @ rotation(
        np.array([0, 0, rng.uniform(-3, 3)])
    )
    T = np.eye(4)
    centre = np.array([*rng.uniform(-spread, spread, 2) * [1, 0.75] * z, z])
    T[:3, :3], T[:3, 3] = R, centre - R @ places(target, all_places(target), spacing).mean(axis=0)
    return T


def coded_boards(camera, target, spacing, seed, views=15, share=0.6, noise=NOISE):
    """`views` boards, each a part of the target, and their true poses."""
    rng = np.random.default_rng(seed)
    boards, poses = [], []
    while len(boards) < views:
        T = pose_before(rng, target, spacing)
        board = seen_part(rng, camera, T, target, spacing, share, noise)
        if board is not None:
            boards.append(board)
            poses.append(T)
    return boards, poses
