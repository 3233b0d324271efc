"""How different the views are: tilts, directions, and pictures that show the same thing twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import flat_points
from rcdn.errors import present
from rcdn.geometry import transform
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Int, Real

SAME_PLACE = 0.02
"""of the picture's longer side: views whose boards lie closer than this, corner by corner (RMS), show the same"""
STEEP = 0.9
"""quantile of the tilts that counts as the largest"""


@dataclass(frozen=True, eq=False)
class ViewFacts:
    """`many` used views, of which `distinct` show the board in a place of its own. `tilt` degrees between board and sensor that a tenth of
    the views exceed; `spread` degrees: standard deviation of the tilts about the axis about which they vary least."""

    many: int
    distinct: int
    tilt: float
    spread: float


def measure_views(calibration: Calibration) -> ViewFacts:
    """The facts of the used views."""
    views = [v for v in calibration.used_views if v.pose is not None]
    if not views:
        return ViewFacts(0, 0, float("nan"), float("nan"))
    tilt = float(np.quantile(tilts(calibration), STEEP))
    return ViewFacts(len(views), len(set(places(calibration, views).tolist())), tilt, tilt_spread(views))


def tilts(calibration: Calibration) -> Real[Array, " v"]:
    """(V,) degrees by which each used board is tilted against the sensor."""
    normals = np.array([v.pose.R[2, 2] for v in calibration.used_views if v.pose is not None])
    return np.degrees(np.arccos(np.clip(np.abs(normals), 0, 1)))


def tilt_spread(views: list[BoardView]) -> float:
    """Degrees by which the boards' normals vary, as standard deviation, in the direction in which they vary least.

    Zero if all boards are tilted about one axis, by whatever angle, or all alike: then focal length and principal point can make up
    for each other.
    """
    normals = np.array([v.pose.R[:, 2] * np.sign(v.pose.R[2, 2] or 1.0) for v in views if v.pose is not None])
    angles = normals[:, :2] * (
        np.arccos(np.clip(normals[:, 2:], -1, 1)) / np.maximum(np.hypot(*normals[:, :2].T), 1e-12)[:, None]
    )
    least = np.linalg.eigvalsh(np.cov(angles.T, bias=True))[0] if len(angles) > 1 else 0.0
    return float(np.degrees(np.sqrt(max(least, 0.0))))


def places(calibration: Calibration, views: list[BoardView]) -> Int[Array, " v"]:
    """(V,) a number for each view, the same for views that show the board in the same place: near-duplicates of a picture."""
    spots = np.array([_outline(calibration, v) for v in views])
    near = SAME_PLACE * max(calibration.camera.image_size)
    group = np.arange(len(views))
    for k in range(len(views)):
        gap = np.sqrt(((spots[k] - spots[:k]) ** 2).sum(axis=-1).mean(axis=-1))
        for other in np.flatnonzero(gap < near):
            group[group == group[k]] = group[other]
    return group


def _outline(calibration: Calibration, view: BoardView) -> Real[Array, "4 2"]:
    """(4, 2) where the corners of the view's part of the board lie, px of a lens without distortion (so that none folds back)."""
    low, high = view.ij.min(axis=0), view.ij.max(axis=0)
    ends = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    flat = np.column_stack([flat_points(calibration, view, ends), np.zeros(4)])
    points = transform(present(view.pose, "the pose of a view"), flat)
    K = calibration.camera.K
    rays = points[:, :2] / np.maximum(points[:, 2:], 1e-3 * np.linalg.norm(points, axis=1, keepdims=True))
    return np.asarray(rays * K[[0, 1], [0, 1]])
