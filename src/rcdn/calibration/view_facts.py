"""Variety of the views: tilts, directions, and pictures that show the board in the same place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import flat_points
from rcdn.errors import present
from rcdn.geometry import transform
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Real

SAME_PLACE = 0.02
"""share of the picture's longer side: boards whose outlines are closer (RMS over their corners) count as one view"""
STEEP = 0.9
"""quantile of the tilts that is reported as the largest"""


@dataclass(frozen=True, eq=False)
class ViewFacts:
    """`many`: number of used views, of which `distinct` show the board in different places. `tilt`, degrees: 90 %
    quantile of the angles between board and sensor; `spread`, degrees: standard deviation of the tilts about the axis
    about which they vary least."""

    many: int
    distinct: int
    tilt: float
    spread: float


def measure_views(calibration: Calibration) -> ViewFacts:
    """`ViewFacts` of the used views."""
    views = [v for v in calibration.used_views if v.pose is not None]
    if not views:
        return ViewFacts(0, 0, float("nan"), float("nan"))
    tilt = float(np.quantile(tilts(calibration), STEEP))
    return ViewFacts(len(views), len(set(places(calibration, views).tolist())), tilt, tilt_spread(views))


def tilt_vectors(views: Iterable[BoardView]) -> Real[Array, "v 2"]:
    """(V, 2) degrees: the angle between board and sensor of each view with a pose, in the direction (x, y) of the
    picture in which the board's normal leans."""
    R = np.array([v.pose.R for v in views if v.pose is not None]).reshape(-1, 3, 3)
    normals = R[:, :, 2] * np.where(R[:, 2:, 2] < 0, -1.0, 1.0)
    angle = np.degrees(np.arccos(np.clip(normals[:, 2:], -1, 1)))
    return normals[:, :2] * (angle / np.maximum(np.hypot(*normals[:, :2].T), 1e-12)[:, None])


def tilts(calibration: Calibration) -> Real[Array, " v"]:
    """(V,) angle between each used board and the sensor, degrees."""
    return np.hypot(*tilt_vectors(calibration.used_views).T)


def tilt_spread(views: Iterable[BoardView]) -> float:
    """Standard deviation of the directions of the boards' normals, degrees, along the direction in which they vary
    least.

    Zero if all boards are tilted about one axis, by whatever angle, or all by the same angle: focal length and
    principal point can then compensate each other.
    """
    angles = tilt_vectors(views)
    least = np.linalg.eigvalsh(np.cov(angles.T, bias=True))[0] if len(angles) > 1 else 0.0
    return float(np.sqrt(max(least, 0.0)))


def places(calibration: Calibration, views: list[BoardView]) -> Real[Array, " v"]:
    """(V,) a group number for each view, equal for views that show the board in the same place (near-duplicates of a
    picture). A view joins the first group whose first view is close to it, so that a board that moves slowly from frame
    to frame eventually begins a new group."""
    spots = np.array([_outline(calibration, v) for v in views])
    near = SAME_PLACE * max(calibration.camera.image_size)
    firsts, group = [0], np.zeros(len(views), int)
    for k in range(1, len(views)):
        gap = np.sqrt(((spots[k] - spots[firsts]) ** 2).sum(axis=-1).mean(axis=-1))
        there = np.flatnonzero(gap < near)
        group[k] = there[0] if len(there) else len(firsts)
        if not len(there):
            firsts.append(k)
    return group


def _outline(calibration: Calibration, view: BoardView) -> Real[Array, "4 2"]:
    """(4, 2) px of the outermost corners of the view's part of the board, projected without distortion (so that the
    projection cannot fold)."""
    low, high = view.ij.min(axis=0), view.ij.max(axis=0)
    ends = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    flat = np.column_stack([flat_points(calibration, view, ends), np.zeros(4)])
    points = transform(present(view.pose, "the pose of a view"), flat)
    K = calibration.camera.K
    rays = points[:, :2] / np.maximum(points[:, 2:], 1e-3 * np.linalg.norm(points, axis=1, keepdims=True))
    return np.asarray(rays * K[[0, 1], [0, 1]])
