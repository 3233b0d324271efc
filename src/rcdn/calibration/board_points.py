"""Where the corners of a calibration's views are on their boards: squares or triangles, and the board's shape."""

from __future__ import annotations

import numpy as np

from rcdn.errors import present
from rcdn.geometry import project, transform
from rcdn.types import Array, BoardView, Calibration, Pattern, plane_points

PATTERNS: tuple[Pattern, ...] = ("checker", "deltille")
ASKED = 3
"""views that tell squares from triangles"""


def pattern_of(calibration: Calibration) -> Pattern:
    """Squares or triangles, which a calibration doesn't keep: under which of the two the used views' poses put the corners where they were seen."""
    views = [v for v in calibration.used_views if v.pose is not None][:ASKED]
    misfit = {p: _misfit(calibration, views, p) for p in PATTERNS}
    return min(PATTERNS, key=lambda p: misfit[p])


def board_points(calibration: Calibration, view: BoardView, pattern: Pattern) -> Array:
    """(M, 3) m: the view's corners in its board's axes, with the board's shape where it is known which corner is which."""
    flat = plane_points(view.ij, pattern) * calibration.spacing
    points = np.column_stack([flat, np.zeros(len(flat))])
    return points + calibration.shape.at(view.ij) if calibration.shape is not None and view.settled else points


def camera_points(calibration: Calibration, view: BoardView, pattern: Pattern) -> Array:
    """(M, 3) m: the view's corners in camera axes; the view has a pose."""
    return transform(present(view.pose, "the pose of a view"), board_points(calibration, view, pattern))


def _misfit(calibration: Calibration, views: list[BoardView], pattern: Pattern) -> float:
    """Median px of the corners from where the residuals say that they were projected."""
    gaps = [
        np.linalg.norm(v.xy - project(calibration.camera, camera_points(calibration, v, pattern)) - v.residuals, axis=1)
        for v in views
    ]
    every = np.concatenate(gaps or [np.zeros(0)])
    return float(np.median(every[np.isfinite(every)])) if np.isfinite(every).any() else float("inf")
