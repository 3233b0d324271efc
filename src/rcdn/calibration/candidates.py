"""Candidate poses of a board held by a person: places in the frame, distances, tilts; and the corners visible in
each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.sight import off_axis
from rcdn.geometry import project, rotation, unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, Camera, Plane
from rcdn.types.arrays import Bool, Real

PLACES = (0.06, 0.28, 0.5, 0.72, 0.94)
"""positions of the board's centre, shares of the frame's width and height"""
TILTS, SIDES = (30.0, 45.0), 8
"""tilts of the board, degrees, in addition to 0, and the number of directions of a tilt"""
MARGIN = 0.01
"""share of the frame's shorter side: corners closer to its border do not count"""
MOST_CORNERS = 7
"""most columns and rows of corners that represent the board's; each has the weight of the corners it stands for"""
GRID = (13, 10)
"""columns and rows of points over the frame, including its border"""


@dataclass(frozen=True, eq=False)
class Candidates:
    """C poses (C, 4, 4), with the pixel of the board's centre (C, 2), distance (C,) m, tilt (C,) degrees, side (C,),
    the number of the tilt's direction among SIDES."""

    T: Array
    middle: Array
    distance: Array
    tilt: Array
    side: Array

    def take(self, index: Array) -> Candidates:
        return Candidates(self.T[index], self.middle[index], self.distance[index], self.tilt[index], self.side[index])


def board_corners(size: tuple[int, int], plane: Plane, spacing: float) -> tuple[Array, float]:
    """(N, 2) m, a subset of the board's corners, evenly spread; and the number of corners that each stands for."""
    picks = [np.unique(np.linspace(0, n - 1, min(n, MOST_CORNERS)).round()) for n in size]
    ij = np.stack(np.meshgrid(*picks), axis=-1).reshape(-1, 2)
    return plane.points(ij) * spacing, size[0] * size[1] / len(ij)


def candidates(
    camera: Camera, size: tuple[int, int], plane: Plane, spacing: float, distances: Real[Array, " d"]
) -> Candidates:
    """All poses of a board of `size` (columns, rows) corners with sides of `spacing` m: places × `distances` (D,) m ×
    tilts."""
    width, height = camera.image_size
    spots = np.array([[x * width, y * height] for y in PLACES for x in PLACES]) - 0.5
    rays = unproject(camera, spots)
    there = np.isfinite(rays).all(axis=1)
    rays, spots = unit(rays[there]), spots[there]
    tilts = [(0.0, 0), *((t, s) for t in TILTS for s in range(SIDES))]
    side = np.radians([360 / SIDES * s for _, s in tilts])
    angle = np.radians([t for t, _ in tilts])
    # a positive rotation about (−sin, cos) moves the side (cos, sin) of the board towards the camera
    lean = rotation(np.stack([-np.sin(side) * angle, np.cos(side) * angle, 0 * angle], axis=-1))
    R = _facing(rays)[:, None] @ lean
    middle = plane.points((np.array(size) - 1) / 2) * spacing
    T = np.tile(np.eye(4), (len(rays), len(distances), len(tilts), 1, 1))
    T[..., :3, :3] = R[:, None]
    T[..., :3, 3] = rays[:, None, None] * distances[:, None, None] - (R[..., :2] @ middle)[:, None]
    shape = T.shape[:3]
    spread = (
        np.broadcast_to(spots[:, None, None], (*shape, 2)).reshape(-1, 2),
        np.broadcast_to(distances[:, None], shape).ravel(),
        np.broadcast_to(np.degrees(angle), shape).ravel(),
        np.broadcast_to([s for _, s in tilts], shape).ravel(),
    )
    return Candidates(T.reshape(-1, 4, 4), *spread)


def _facing(rays: Real[Array, "k 3"]) -> Real[Array, "k 3 3"]:
    """(K, 3, 3) the smallest rotations that take the z axis to unit `rays` (K, 3)."""
    axis = np.stack([-rays[:, 1], rays[:, 0], 0 * rays[:, 0]], axis=-1)
    sine = np.linalg.norm(axis, axis=1)
    return rotation(axis * (np.arctan2(sine, rays[:, 2]) / np.maximum(sine, 1e-12))[:, None])


def placed(T: Real[Array, "c 4 4"], board: Real[Array, "n 2"]) -> Real[Array, "c n 3"]:
    """(C, N, 3) camera coordinates of `board` (N, 2) under poses `T` (C, 4, 4)."""
    return np.asarray(board @ T[:, :3, :2].transpose(0, 2, 1) + T[:, None, :3, 3])


def in_frame(camera: Camera, points: Real[Array, "c n 3"]) -> Bool[Array, "c n"]:
    """(C, N) bool: the corner at `points` (C, N, 3), m, camera coordinates, projects into the frame, and the angle of
    its ray from the axis does not exceed the largest in the frame, so that it is not beyond a fold."""
    width, height = camera.image_size
    xy = project(camera, points)
    edge = MARGIN * min(width, height)
    inside = (xy >= edge).all(axis=2) & (xy <= np.array([width - 1, height - 1]) - edge).all(axis=2)
    widest = float(np.nanmax(off_axis(camera, frame_grid(camera.image_size)), initial=0.0))
    angle = np.degrees(np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2]))
    return np.asarray(inside & (angle <= widest))


def frame_grid(image_size: tuple[int, int]) -> Real[Array, "g 2"]:
    """(G, 2) px: a regular grid over the frame, including its border, row by row."""
    x, y = (np.linspace(0, n - 1, k) for n, k in zip(image_size, GRID, strict=True))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
