"""What is measured in a calibration, once, so that verdict, figures and drawings agree: geometry and uncertainty over the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_facts import BoardFacts, measure_board
from rcdn.calibration.residual_facts import ResidualFacts, measure_residuals
from rcdn.calibration.sight import cell_centres, cells_of, off_axis, out_of_sight
from rcdn.calibration.uncertainty import coverage, projection_uncertainty
from rcdn.calibration.view_facts import ViewFacts, measure_views
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Bool

GRID = 120
"""boxes along the frame's longer side in whose middles the projection uncertainty is measured"""
FINE = 0.01
"""px; an RMS below counts as this where one is stated as a multiple of another: such small ones are rounding, not noise"""


@dataclass(frozen=True, eq=False)
class Facts:
    """`coverage` (rows, cols) used corners in each cell; `in_view` (rows, cols) cells that count; `covered` the share of those with a
    corner. `uncertainty` (h, w) px in the middles of small boxes all over the frame, NaN where there's no ray; `beyond` (h, w) those
    that don't count, out of the lens's sight, and `broken` those where the lens model ends though there is a picture; `reach` the
    share of the others. `corners` (2, 2) px in the frame's corners and `middle`; `at_corners` the worst corner (the worst anywhere, if
    no corner counts; infinite if the model is broken there), `typical` the median over the frame. `fov` horizontal,
    vertical and diagonal, degrees. `focal_std` relative, the worse axis; `centre_std` px, the worse axis; `aspect` fy ÷ fx and its
    standard deviation `aspect_std`. `seen` corners in all views, `used` those that the calibration rests on. `held_ratio`: error in
    pictures held out ÷ that of the calibration, both on the corners on which lens models were compared; NaN if nothing was held out.
    `residuals`, `views`, `board`: what residuals and poses show, and what they ask of the board."""

    coverage: Array
    in_view: Array
    covered: float
    uncertainty: Array
    beyond: Array
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
        beyond=beyond,
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


def _aspect_std(calibration: Calibration) -> float:
    """Standard deviation of fy ÷ fx, by propagation of the covariance of both."""
    fx, fy = calibration.camera.parameters[:2]
    by = np.array([-fy / fx, 1]) / fx
    return float(np.sqrt(max(by @ calibration.cov[:2, :2] @ by, 0.0)))


def _held_ratio(calibration: Calibration) -> float:
    """One score holds both on the same corners; the calibration's own RMS is of the corners that it uses."""
    if not calibration.models:
        return float("nan")
    score = calibration.models[0]
    return multiple(score.held_out, score.rms)


def multiple(rms: float, of: float) -> float:
    """One RMS, px, as a multiple of another; those below FINE count as that. NaN of NaN."""
    return max(rms, FINE) / max(of, FINE)


def _uncertainty(calibration: Calibration, pixels: Array) -> Array:
    flat = projection_uncertainty(calibration, pixels.reshape(-1, 2))
    return np.asarray(flat, float).reshape(pixels.shape[:-1])


def cell_majority(mask: Bool[Array, "h w"], cells: tuple[int, int]) -> Array:
    """(rows, cols) bool: at least half of the points of `mask` (h, w) that fall into the cell are true."""
    row = np.minimum(np.arange(mask.shape[0]) * cells[1] // mask.shape[0], cells[1] - 1)
    col = np.minimum(np.arange(mask.shape[1]) * cells[0] // mask.shape[1], cells[0] - 1)
    flat = (row[:, None] * cells[0] + col).ravel()
    share = np.bincount(flat, mask.ravel(), cells[0] * cells[1]) / np.maximum(
        np.bincount(flat, minlength=cells[0] * cells[1]), 1
    )
    return np.asarray(share.reshape(cells[1], cells[0]) >= 0.5)


def _ends(field: Array) -> Bool[Array, "2 2"]:
    """(2, 2) the values in a field's corners."""
    return field[[[0], [-1]], [0, -1]]


def _worst_corner(ends: Array, spread: Array, broken: Array) -> float:
    if _ends(broken).any():
        return float("inf")
    known = ends if np.isfinite(ends).any() else spread[np.isfinite(spread)]
    return float(np.nanmax(known)) if np.isfinite(known).any() else float("nan")


def field_of_view(camera: Camera) -> tuple[float, float, float]:
    """Horizontal, vertical and diagonal angle, degrees, between the rays of the frame's edges; NaN where the lens has no ray."""
    width, height = camera.image_size
    (cx, cy), right, bottom = camera.K[:2, 2], width - 0.5, height - 0.5
    pairs = [
        [(-0.5, cy), (right, cy)],
        [(cx, -0.5), (cx, bottom)],
        [(-0.5, -0.5), (right, bottom)],
    ]
    angle = off_axis(camera, np.array(pairs, float)).sum(axis=1)  # through the axis: a fisheye may have more than 180°
    return float(angle[0]), float(angle[1]), float(angle[2])
