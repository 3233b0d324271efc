"""Positions of the corners of a calibration's views on their boards, for squares, triangles or tags, including the
board's shape."""

from __future__ import annotations

import numpy as np

from rcdn.errors import present
from rcdn.geometry import project, transform
from rcdn.types import Array, BoardView, Calibration, Pattern, Plane
from rcdn.types.arrays import Real

PATTERNS: tuple[Pattern, ...] = ("checker", "deltille")
MOST_VIEWS = 3
"""views used to distinguish squares from triangles"""


def plane_of(calibration: Calibration, view: BoardView | None = None) -> Plane:
    """The printed plane of a view's board, by default of the calibration's own board.

    If the views do not contain it, the pattern (squares or triangles) with the least deviation from the stored
    residuals.
    """
    if view is None:
        view = next((v for v in calibration.used_views if v.target == calibration.target), None)
    if view is not None and view.plane is not None:
        return view.plane
    views = [v for v in calibration.used_views if v.pose is not None and v.plane is None][:MOST_VIEWS]
    misfit = {p: _misfit(calibration, views, Plane(p)) for p in PATTERNS}
    return Plane(min(PATTERNS, key=lambda p: misfit[p]))


def side_of(calibration: Calibration, view: BoardView) -> float:
    """The side of a square, a triangle or a tag of the view's board, m."""
    return calibration.spacing if view.spacing is None else view.spacing


def flat_points(
    calibration: Calibration, view: BoardView, ij: Real[Array, "... 2"] | None = None
) -> Real[Array, "... 2"]:
    """(..., 2) m: positions of the view's corners, or of the labels `ij` (..., 2), on its perfect board."""
    return plane_of(calibration, view).points(view.ij if ij is None else ij) * side_of(calibration, view)


def has_shape(calibration: Calibration, view: BoardView) -> bool:
    """Whether the displacements of the view's corners are known: the board is the calibration's own, and it is known
    which corner is which."""
    return calibration.shape is not None and view.settled and view.target == calibration.target


def board_points(calibration: Calibration, view: BoardView, plane: Plane | None = None) -> Real[Array, "m 3"]:
    """(M, 3) m: the view's corners in its board's axes, including the board's shape where it is known which corner is
    which."""
    flat = (plane or plane_of(calibration, view)).points(view.ij) * side_of(calibration, view)
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points + present(calibration.shape, "the shape").at(view.ij) if has_shape(calibration, view) else points


def _misfit(calibration: Calibration, views: list[BoardView], plane: Plane) -> float:
    """Median distance, px, between the corners and the positions that projections and stored residuals imply."""
    gaps = []
    for v in views:
        points = transform(present(v.pose, "the pose of a view"), board_points(calibration, v, plane))
        gaps.append(np.linalg.norm(v.xy - project(calibration.camera, points) - v.residuals, axis=1))
    every = np.concatenate(gaps or [np.zeros(0)])
    return float(np.median(every[np.isfinite(every)])) if np.isfinite(every).any() else float("inf")
