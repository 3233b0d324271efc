"""Geometry of a calibration and its uncertainty over the sensor, measured once for the verdict, the figures and the
drawings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.calibration.residual_facts import ResidualFacts, measure_residuals
from rcdn.calibration.sight import cell_centres, cells_of, off_axis, out_of_sight
from rcdn.calibration.uncertainty import coverage, projection_uncertainty
from rcdn.calibration.view_facts import ViewFacts, measure_views
from rcdn.types import Array, Calibration, Camera

GRID = 120
"""boxes along the frame's longer side at whose centres the projection uncertainty is evaluated"""
FINE = 0.01
"""px; a smaller RMS counts as this in ratios of two RMS values: such small ones are rounding error, not noise"""


@dataclass(frozen=True)
class BoardFacts:
    """`stretch`: relative excess of the distance of the board's columns over that of its rows; `bend`: distance of its
    corners from a plane, from the lowest to the highest, as a share of its longer side. NaN if the shape was not
    estimated."""

    stretch: float
    bend: float


@dataclass(frozen=True, eq=False)
class Facts:
    """`coverage` (rows, cols) number of used corners in each cell; `in_view` (rows, cols) cells that count; `covered`,
    the share of those with a corner. `uncertainty` (h, w) px at the centres of small boxes over the frame, NaN without
    a ray; `broken` (h, w) boxes in which the lens model has no ray though the lens images something; `reach`, the share
    of valid boxes among those that count, which do not lie outside what the lens images.
    `corners` (2, 2) px uncertainty in the frame's corners, and in its `middle`; `at_corners`, that of the worst corner
    (of the worst box if no corner counts; infinite if the model is invalid in a corner); `typical`, the median over the
    frame. `fov` horizontal, vertical and diagonal, degrees. `focal_std` relative, of the worse axis; `centre_std` px,
    of the worse axis; `aspect` fy ÷ fx and its standard deviation `aspect_std`. `seen`, number of corners in all views;
    `used`, number of those used by the estimate. `held_ratio`: error in held-out pictures ÷ that of the fit, both on
    the corners on which lens models were compared; NaN if nothing was held out. `residuals`, `views`, `board`:
    properties of the residuals, of the poses and of the board's shape."""

    coverage: Array
    in_view: Array
    covered: float
    uncertainty: Array
    broken: Array
    reach: float
    corners: Array
    middle: float
    at_corners: float
    typical: float
    fov: tuple[float, float, float]
    focal_std: float
    centre_std: float
    aspect: float
    aspect_std: float
    seen: int
    used: int
    held_ratio: float
    residuals: ResidualFacts
    views: ViewFacts
    board: BoardFacts


def measure(calibration: Calibration) -> Facts:
    """All facts of one calibration."""
    camera = calibration.camera
    cells = cells_of(camera.image_size)
    count = np.asarray(coverage(calibration, cells=cells))
    points = cell_centres(camera.image_size, cells_of(camera.image_size, GRID))
    beyond, broken = out_of_sight(camera, points)
    in_view = ~cell_majority(beyond, cells) | (count > 0)
    spread = np.where(beyond | broken, np.nan, _uncertainty(calibration, points))
    width, height = camera.image_size
    ends = _uncertainty(calibration, np.array([[[x, y] for x in (0.0, width - 1)] for y in (0.0, height - 1)]))
    ends = np.where(_ends(beyond), np.nan, ends)
    std, K = calibration.std, camera.K
    return Facts(
        coverage=count,
        in_view=in_view,
        covered=float((count > 0).sum() / max(in_view.sum(), 1)),
        uncertainty=spread,
        broken=broken,
        reach=float(1 - broken.sum() / max((~beyond).sum(), 1)),
        corners=ends,
        middle=float(spread[len(spread) // 2, spread.shape[1] // 2]),
        at_corners=_worst_corner(ends, spread, broken),
        typical=float(np.nanmedian(spread)) if np.isfinite(spread).any() else float("nan"),
        fov=field_of_view(camera),
        focal_std=float(np.max(std[:2] / K[[0, 1], [0, 1]])),
        centre_std=float(np.max(std[2:4])),
        aspect=float(K[1, 1] / K[0, 0]),
        aspect_std=_aspect_std(calibration),
        seen=sum(len(v) for v in calibration.views),
        used=sum(int(v.used.sum()) for v in calibration.used_views),
        held_ratio=_held_ratio(calibration),
        residuals=measure_residuals(calibration),
        views=measure_views(calibration),
        board=measure_board(calibration),
    )


def measure_board(calibration: Calibration) -> BoardFacts:
    """From `calibration.shape`. Columns and rows of a board with quarter-turn symmetry cannot be distinguished: NaN."""
    shape = calibration.shape
    if shape is None or calibration.orientation == "ambiguous_90":
        return BoardFacts(float("nan"), float("nan"))
    sides = plane_of(calibration).points(np.array(shape.size) - 1) * calibration.spacing
    step = float(np.mean(sides / np.maximum(np.array(shape.size) - 1, 1)))
    return BoardFacts(shape.stretch / step, shape.bend / float(max(sides)))


def _aspect_std(calibration: Calibration) -> float:
    """Standard deviation of fy ÷ fx, by propagation of the covariance of both."""
    fx, fy = calibration.camera.parameters[:2]
    by = np.array([-fy / fx, 1]) / fx
    return float(np.sqrt(max(by @ calibration.cov[:2, :2] @ by, 0.0)))


def _held_ratio(calibration: Calibration) -> float:
    """Both errors are taken from one model score, on the same corners; the calibration's own RMS is that of the corners
    that it uses."""
    if not calibration.models:
        return float("nan")
    score = calibration.models[0]
    return multiple(score.held_out, score.rms)


def multiple(rms: float, of: float) -> float:
    """Ratio of two RMS values, px; values below FINE count as FINE. NaN if one is NaN."""
    return max(rms, FINE) / max(of, FINE)


def _uncertainty(calibration: Calibration, pixels: Array) -> Array:
    flat = projection_uncertainty(calibration, pixels.reshape(-1, 2))
    return np.asarray(flat, float).reshape(pixels.shape[:-1])


def cell_majority(mask: Array, cells: tuple[int, int]) -> Array:
    """(rows, cols) bool: at least half of the points of `mask` (h, w) in the cell are true."""
    row = np.minimum(np.arange(mask.shape[0]) * cells[1] // mask.shape[0], cells[1] - 1)
    col = np.minimum(np.arange(mask.shape[1]) * cells[0] // mask.shape[1], cells[0] - 1)
    flat = (row[:, None] * cells[0] + col).ravel()
    share = np.bincount(flat, mask.ravel(), cells[0] * cells[1]) / np.maximum(
        np.bincount(flat, minlength=cells[0] * cells[1]), 1
    )
    return np.asarray(share.reshape(cells[1], cells[0]) >= 0.5)


def _ends(field: Array) -> Array:
    """(2, 2) the values at the four corners of an array."""
    return field[[[0], [-1]], [0, -1]]


def _worst_corner(ends: Array, spread: Array, broken: Array) -> float:
    if _ends(broken).any():
        return float("inf")
    known = ends if np.isfinite(ends).any() else spread[np.isfinite(spread)]
    return float(np.nanmax(known)) if np.isfinite(known).any() else float("nan")


def field_of_view(camera: Camera) -> tuple[float, float, float]:
    """Horizontal, vertical and diagonal angle of view, degrees, between the rays at the frame's edges; NaN where the
    lens has no ray."""
    width, height = camera.image_size
    (cx, cy), right, bottom = camera.K[:2, 2], width - 0.5, height - 0.5
    pairs = [
        [(-0.5, cy), (right, cy)],
        [(cx, -0.5), (cx, bottom)],
        [(-0.5, -0.5), (right, bottom)],
    ]
    angle = off_axis(camera, np.array(pairs, float)).sum(axis=1)  # measured through the axis: a fisheye may exceed 180°
    return float(angle[0]), float(angle[1]), float(angle[2])
