"""What the report measures in a calibration, once, so that verdict, figures and drawings agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration import coverage, projection_uncertainty
from rcdn.geometry import unproject
from rcdn.types import Array, BoardView, Calibration, Camera

LONGER = 8
"""cells of the coverage along the frame's longer side"""
GRID = 33
"""points along the frame's longer side at which the projection uncertainty is measured"""
WIDEST = 90.0
"""degrees off the axis; what a fisheye sees beyond is taken for the dark around its circle, and doesn't count"""


@dataclass(frozen=True, eq=False)
class Facts:
    """`coverage` (rows, cols) used corners in each cell; `in_view` (rows, cols) cells that the lens can fill; `covered` the share
    of those with a corner. `uncertainty` (h, w) px at points spread evenly from edge to edge of the frame, NaN out of view;
    `at_corners` the worst of its four corners (of all in view, if no corner is), `typical` its median. `fov` horizontal,
    vertical and diagonal, degrees. `focal_std` relative, the worse axis; `centre_std` px, the worse axis."""

    coverage: Array
    in_view: Array
    covered: float
    uncertainty: Array
    at_corners: float
    typical: float
    fov: tuple[float, float, float]
    focal_std: float
    centre_std: float
    seen: int
    used: int

    @property
    def dropped(self) -> float:
        """Share of the corners seen that the calibration doesn't rest on."""
        return 1 - self.used / self.seen if self.seen else float("nan")


def measure(calibration: Calibration) -> Facts:
    """All facts of one calibration."""
    camera = calibration.camera
    cells = cells_of(camera.image_size)
    count = np.asarray(coverage(calibration, cells=cells))
    in_view = sees(camera, cell_centres(camera.image_size, cells)) | (count > 0)
    points = grid_points(camera.image_size)
    spread = np.asarray(projection_uncertainty(calibration, points.reshape(-1, 2)), float).reshape(points.shape[:2])
    spread = np.where(sees(camera, points), spread, np.nan)
    ends = spread[[0, 0, -1, -1], [0, -1, 0, -1]]
    known = ends if np.isfinite(ends).any() else spread[np.isfinite(spread)]
    std, K = calibration.std, camera.K
    return Facts(
        coverage=count,
        in_view=in_view,
        covered=float((count > 0).sum() / max(in_view.sum(), 1)),
        uncertainty=spread,
        at_corners=float(np.nanmax(known)) if np.isfinite(known).any() else float("nan"),
        typical=float(np.nanmedian(spread)) if np.isfinite(spread).any() else float("nan"),
        fov=field_of_view(camera),
        focal_std=float(np.max(std[:2] / K[[0, 1], [0, 1]])),
        centre_std=float(np.max(std[2:4])),
        seen=sum(len(v) for v in calibration.views),
        used=sum(int(v.used.sum()) for v in calibration.used_views),
    )


def cells_of(image_size: tuple[int, int]) -> tuple[int, int]:
    """(columns, rows) of nearly square cells, LONGER along the longer side."""
    width, height = image_size
    side = max(width, height) / LONGER
    return max(round(width / side), 2), max(round(height / side), 2)


def cell_centres(image_size: tuple[int, int], cells: tuple[int, int]) -> Array:
    """(rows, cols, 2) px."""
    (width, height), (cols, rows) = image_size, cells
    x = (np.arange(cols) + 0.5) * width / cols - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(x, y), axis=-1)


def grid_points(image_size: tuple[int, int]) -> Array:
    """(h, w, 2) px, from the first pixel's centre to the last one's."""
    width, height = image_size
    step = max(width, height) / (GRID - 1)
    many = [max(round(side / step), 4) + 1 for side in (width, height)]
    x, y = np.linspace(0, width - 1, many[0]), np.linspace(0, height - 1, many[1])
    return np.stack(np.meshgrid(x, y), axis=-1)


def sees(camera: Camera, pixels: Array) -> Array:
    """(...,) bool: the lens has a ray for the pixel (..., 2), no more than WIDEST off the axis."""
    rays = unproject(camera, pixels)
    angle = np.degrees(np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2]))
    return np.asarray(np.isfinite(angle) & (angle <= WIDEST))


def field_of_view(camera: Camera) -> tuple[float, float, float]:
    """Horizontal, vertical and diagonal angle, degrees, between the rays of the frame's edges; NaN where the lens has no ray."""
    width, height = camera.image_size
    (cx, cy), right, bottom = camera.K[:2, 2], width - 0.5, height - 0.5
    pairs = [
        [(-0.5, cy), (right, cy)],
        [(cx, -0.5), (cx, bottom)],
        [(-0.5, -0.5), (right, bottom)],
    ]
    rays = unproject(camera, np.array(pairs, float))
    # measured through the axis, so that a fisheye may have more than 180°
    angle = np.degrees(np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])).sum(axis=1)
    return float(angle[0]), float(angle[1]), float(angle[2])


def used_residuals(calibration: Calibration) -> tuple[Array, Array]:
    """Positions and residuals of all used corners, (N, 2) each, px."""
    return stacked(calibration.used_views)


def stacked(views: tuple[BoardView, ...]) -> tuple[Array, Array]:
    """Positions and finite residuals of the used corners of `views`, (N, 2) each, px."""
    xy = np.concatenate([v.xy[v.used] for v in views] or [np.zeros((0, 2))])
    residuals = np.concatenate([v.residuals[v.used] for v in views] or [np.zeros((0, 2))])
    known = np.isfinite(residuals).all(axis=1)
    return xy[known], residuals[known]


def thinned(many: int, most: int) -> Array:
    """Indices of at most `most` of `many` rows, evenly spread and always the same."""
    return np.arange(many) if many <= most else np.linspace(0, many - 1, most).astype(int)
