"""Where the corners of a calibration's views are on their boards: squares, triangles or tags, and the board's shape."""

from __future__ import annotations

import numpy as np

from rcdn.errors import present
from rcdn.geometry import project, transform
from rcdn.types import Array, BoardView, Calibration, Pattern, Plane
from rcdn.types.arrays import Int, Real

PATTERNS: tuple[Pattern, ...] = ("checker", "deltille")
ASKED = 3
"""views that tell squares from triangles"""


def plane_of(calibration: Calibration, view: BoardView | None = None) -> Plane:
    """The printed plane of a view's board, by default of the calibration's own one.

    Where the views don't say it, the one of squares and triangles under which their poses put the corners where they were seen.
    """
    if view is None:
        view = next((v for v in calibration.used_views if v.target == calibration.target), None)
    if view is not None and view.plane is not None:
        return view.plane
    views = [v for v in calibration.used_views if v.pose is not None and v.plane is None][:ASKED]
    misfit = {p: _misfit(calibration, views, Plane(p)) for p in PATTERNS}
    return Plane(min(PATTERNS, key=lambda p: misfit[p]))


def side_of(calibration: Calibration, view: BoardView) -> float:
    """m: the side of a square, a triangle or a tag of the view's board."""
    return calibration.spacing if view.spacing is None else view.spacing


def flat_points(
    calibration: Calibration, view: BoardView, ij: Int[Array, "... 2"] | None = None
) -> Real[Array, "... 2"]:
    """(..., 2) m: where the view's corners, or the labels `ij` (..., 2), lie on its perfect board."""
    return plane_of(calibration, view).points(view.ij if ij is None else ij) * side_of(calibration, view)


def has_shape(calibration: Calibration, view: BoardView) -> bool:
    """Whether it is known how far the view's corners lie off the perfect board: it is the calibration's own, and settled which corner is which."""
    return calibration.shape is not None and view.settled and view.target == calibration.target


def board_points(calibration: Calibration, view: BoardView, plane: Plane | None = None) -> Real[Array, "m 3"]:
    """(M, 3) m: the view's corners in its board's axes, with the board's shape where it is known which corner is which."""
    flat = (plane or plane_of(calibration, view)).points(view.ij) * side_of(calibration, view)
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points + present(calibration.shape, "the shape").at(view.ij) if has_shape(calibration, view) else points


def _misfit(calibration: Calibration, views: list[BoardView], plane: Plane) -> float:
    """Median px of the corners from where the residuals say that they were projected."""
    gaps = []
    for v in views:
        points = transform(present(v.pose, "the pose of a view"), board_points(calibration, v, plane))
        gaps.append(np.linalg.norm(v.xy - project(calibration.camera, points) - v.residuals, axis=1))
    every = np.concatenate(gaps or [np.zeros(0)])
    return float(np.median(every[np.isfinite(every)])) if np.isfinite(every).any() else float("inf")
