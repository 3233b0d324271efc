"""Structure of the residuals: means over cells of the sensor, correlation of neighbours, regions in which corners are
left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.sight import cell_centres, cells_of
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Int, Real

FINER = 1.5
"""ratio of the number of cells of the mean residuals to that of the coverage, along one side"""
FEWEST_VIEWS = 3
"""least number of views in a cell for a mean"""
SIGNIFICANT = 3.0
"""standard errors above which a cell's mean is systematic"""
VISIBLE = 0.1
"""px below which a systematic mean is negligible"""
CROWD = 10
"""least number of corners seen in a region of the sensor for a share of those left out"""
ROUGHER = 0.5
"""share of the views, those with the smallest RMS, against which the others are compared"""


@dataclass(frozen=True, eq=False)
class Cells:
    """Mean residuals in cells of the sensor: `where` (C, 2) centres, `mean` (C, 2), `error` (C,) its standard error
    along one axis, px, and `systematic` (C,) bool."""

    where: Array
    mean: Array
    error: Array
    systematic: Array

    @property
    def share(self) -> float:
        """Share of systematic cells; NaN without any cell."""
        return float(self.systematic.mean()) if len(self.systematic) else float("nan")

    @property
    def largest(self) -> float:
        """Length of the largest systematic mean, px; 0 if there is none."""
        return float(np.hypot(*self.mean[self.systematic].T).max(initial=0.0))

    @property
    def rms(self) -> float:
        """Root mean square over all cells of the systematic means, px; NaN without any cell."""
        squares = np.where(self.systematic, (self.mean**2).sum(axis=1), 0.0)
        return float(np.sqrt(squares.mean())) if len(squares) else float("nan")


@dataclass(frozen=True, eq=False)
class ResidualFacts:
    """`cells`. `correlation` of the residuals of neighbouring corners of one view, and `smooth`, the RMS of the part of
    the residuals that neighbours share, px. `uneven`: RMS of the half of the views with the larger residuals ÷ that of
    the others; `rough`, the former, px. `dropped`, share of the corners of used views that were left out; `crowded`,
    the largest such share in one region of the sensor, around `crowd` (2,) px (NaN if there is none)."""

    cells: Cells
    correlation: float
    smooth: float
    uneven: float
    rough: float
    dropped: float
    crowded: float
    crowd: Array


def measure_residuals(calibration: Calibration) -> ResidualFacts:
    """`ResidualFacts` of the used views."""
    correlation = neighbour_correlation(calibration)
    uneven, rough = _unevenness(calibration)
    crowded, crowd = _crowd(calibration)
    seen = sum(len(v) for v in calibration.used_views)
    return ResidualFacts(
        cells=mean_residuals(calibration),
        correlation=correlation,
        smooth=float(np.sqrt(np.fmax(correlation, 0.0)) * calibration.rms),
        uneven=uneven,
        rough=rough,
        dropped=calibration.outliers / seen if seen else float("nan"),
        crowded=crowded,
        crowd=crowd,
    )


def used_residuals(calibration: Calibration) -> tuple[Array, Array]:
    """Positions and residuals of all used corners, (N, 2) each, px."""
    return stacked(calibration.used_views)


def stacked(views: tuple[BoardView, ...]) -> tuple[Array, Array]:
    """Positions and finite residuals of the used corners of `views`, (N, 2) each, px."""
    xy = np.concatenate([v.xy[v.used] for v in views] or [np.zeros((0, 2))])
    residuals = np.concatenate([v.residuals[v.used] for v in views] or [np.zeros((0, 2))])
    known = np.isfinite(residuals).all(axis=1)
    return xy[known], residuals[known]


def mean_residuals(calibration: Calibration) -> Cells:
    """Means over the views of each view's mean residual in a cell, because the errors of the corners of one view are
    correlated.

    Their standard error is estimated from the scatter of the views in the cell or in all cells, whichever is larger:
    three views alone give a poor estimate. A mean is systematic above SIGNIFICANT standard errors (by chance in 1.1 %
    of the cells) and VISIBLE px.
    """
    image_size = calibration.camera.image_size
    cols, rows = (round(FINER * n) for n in cells_of(image_size))
    total, square, many = np.zeros((rows * cols, 2)), np.zeros(rows * cols), np.zeros(rows * cols)
    for view in calibration.used_views:
        xy, residuals = stacked((view,))
        flat = _cell_of(xy, image_size, (cols, rows))
        count = np.bincount(flat, minlength=rows * cols)
        seen = count > 0
        means = (
            np.stack([np.bincount(flat, residuals[:, a], rows * cols) for a in (0, 1)], axis=1)[seen]
            / count[seen, None]
        )
        total[seen] += means
        square[seen] += (means**2).sum(axis=1)
        many[seen] += 1
    enough = many >= FEWEST_VIEWS
    total, square, many = total[enough], square[enough], many[enough]
    mean = total / many[:, None]
    own = np.maximum(square / many - (mean**2).sum(axis=1), 0) / 2 * many / (many - 1)
    pooled = float((own * (many - 1)).sum() / (many - 1).sum()) if len(many) else 0.0
    error = np.sqrt(np.maximum(own, pooled) / many)
    size = np.hypot(*mean.T)
    systematic = (size > SIGNIFICANT * error) & (size > VISIBLE)
    return Cells(cell_centres(image_size, (cols, rows)).reshape(-1, 2)[enough], mean, error, systematic)


def _cell_of(xy: Real[Array, "n 2"], image_size: tuple[int, int], cells: tuple[int, int]) -> Int[Array, " n"]:
    """(N,) number of the cell, among (columns, rows), that contains each of `xy` (N, 2) px."""
    at = np.floor((xy + 0.5) / np.array(image_size) * cells).astype(int).clip(0, np.array(cells) - 1)
    return np.asarray(at[:, 1] * cells[0] + at[:, 0])


def neighbour_correlation(calibration: Calibration) -> float:
    """Correlation of the residuals of corners that are neighbours on the board, over all used views; NaN without
    neighbours.

    Independent noise gives about 0, a bent board or errors of the lens model up to 1.
    """
    product = power = 0.0
    for view in calibration.used_views:
        first, second = _neighbours(view, view.used & np.isfinite(view.residuals).all(axis=1))
        a, b = view.residuals[first], view.residuals[second]
        product += float((a * b).sum())
        power += float((a**2).sum() + (b**2).sum()) / 2
    return product / power if power > 0 else float("nan")


def _neighbours(view: BoardView, which: Array) -> tuple[Array, Array]:
    """Indices of all pairs of corners, among `which` (M,) bool, that are neighbours on the board."""
    at = np.flatnonzero(which)
    if not len(at):
        return at, at
    ij = view.ij[at] - view.ij[at].min(axis=0)
    place = np.full(tuple(ij.max(axis=0) + 2), -1)
    place[ij[:, 0], ij[:, 1]] = at
    pairs = [(place[:-1], place[1:]), (place[:, :-1], place[:, 1:])]
    both = [(a >= 0) & (b >= 0) for a, b in pairs]
    first = np.concatenate([a[m] for (a, _), m in zip(pairs, both, strict=True)])
    return first, np.concatenate([b[m] for (_, b), m in zip(pairs, both, strict=True)])


def _unevenness(calibration: Calibration) -> tuple[float, float]:
    """RMS of the half of the views with the larger residuals ÷ that of the others, and the former, px; NaN with one
    view."""
    rms = np.sort([v.rms for v in calibration.used_views if np.isfinite(v.rms)])
    half = int(len(rms) * ROUGHER)
    if not half:
        return float("nan"), float("nan")
    fine, rough = (float(np.sqrt((part**2).mean())) for part in (rms[:half], rms[half:]))
    return rough / max(fine, 1e-9), rough


def _crowd(calibration: Calibration) -> tuple[float, Array]:
    """Largest share of corners left out in a cell of the sensor, and the cell's centre, px. The number left out is
    reduced by two standard deviations of chance, so that a few in a small cell do not count; views left out as a whole
    do not count."""
    image_size = calibration.camera.image_size
    cells = cells_of(image_size)
    views = calibration.used_views
    xy = np.concatenate([v.xy for v in views] or [np.zeros((0, 2))])
    out = np.concatenate([~v.used for v in views] or [np.zeros(0, bool)])
    flat = _cell_of(xy, image_size, cells)
    many = np.bincount(flat, minlength=cells[0] * cells[1])
    lost = np.bincount(flat[out], minlength=cells[0] * cells[1])
    share = np.where(many >= CROWD, (lost - 2 * np.sqrt(lost)) / np.maximum(many, 1), 0.0)
    worst = int(np.argmax(share))
    if share[worst] <= 0:
        return 0.0, np.full(2, np.nan)
    return float(share[worst]), cell_centres(image_size, cells).reshape(-1, 2)[worst]
