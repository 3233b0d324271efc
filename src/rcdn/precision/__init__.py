"""The final fit: the corners of a recovered board are fitted again with the board known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.corners.adaptive import nearest_pitch
from rcdn.geometry.median import median
from rcdn.precision.fit import Fit, fit_corners
from rcdn.precision.lattice import lattice
from rcdn.precision.model import CONTRAST
from rcdn.precision.smooth import smooth
from rcdn.precision.surroundings import Surroundings
from rcdn.types import Array, Board, Status
from rcdn.types.arrays import Bool, Real, Shaped

__all__ = ["sharpen"]

FAR = 0.15
"""largest distance by which the fit may move a refined corner, share of the pitch"""
FAINT = 0.2
"""least contrast, share of the board's median"""
NOTHING = 0.25
"""grey levels; with less contrast than this a corner is not visible"""
NOISY = 9.0
"""largest residual variance, × the board's median"""
KEPT = 0.5
"""least share of a corner's pixels that must agree with the model"""
COVERED = 0.9
"""share of a corner's pixels that agree with the model, × the board's median, below which something covers it"""
FURTHER, ASTRAY, TOGETHER = 1.2, 0.02, 0.05
"""largest distance of a fitted corner from its neighbours' prediction: × the distance before the fit, + squares, of
fitted neighbours and of those before the fit"""
DOUBTFUL = 3.0
"""least standard deviation of a corner whose fit failed, × the board's median"""


def sharpen(
    grey: Shaped[Array, "h w"], board: Board, geometry: bool = True, around: Surroundings | None = None
) -> Board:
    """The same board with corner positions fitted by a model of the picture, and their `sigma` (M,), px along an axis.

    `grey` (H, W), 0..255; `geometry`: the positions are also estimated from the smoothness of the board; `around`: what
    is printed besides squares. No corner is added, dropped or relabelled. A corner whose fit fails keeps its position,
    with a larger sigma. If something covers it in part, and its fit fails or disagrees with the others, it gets the
    position that the board predicts by its `geometry`, where that is near and more certain.
    """
    if len(board) < 4 or np.ptp(board.ij, axis=0).min() < 1:
        return board
    try:
        fit = fit_corners(grey, board.ij, board.xy, around)
    except np.linalg.LinAlgError:  # so strongly distorted that a local map is singular: the board can't be improved
        return board
    plane = None if around is None else around.plane
    good = _good(board, fit, plane)
    if not good.any():
        return board
    xy = np.where(good[:, None], fit.xy, board.xy)
    lost = np.maximum(DOUBTFUL * median(_sigma(fit.cov)[good]), np.linalg.norm(fit.xy - board.xy, axis=1) / np.sqrt(2))
    cov = np.where(good[:, None, None], fit.cov, (np.nan_to_num(lost, nan=1.0) ** 2)[:, None, None] * np.eye(2))
    if geometry:
        covered = fit.kept < COVERED * median(fit.kept)
        xy, cov = smooth(board.ij, xy, cov, good, None if around is None else around.plane_of(xy), covered)
    return replace(board, xy=xy, sigma=_sigma(cov))


def _sigma(cov: Array) -> Real[Array, " m"]:
    """Standard deviations (M,) along an axis, RMS of both axes, from covariances (M, 2, 2)."""
    return np.sqrt((cov[:, 0, 0] + cov[:, 1, 1]) / 2)


def _good(board: Board, fit: Fit, plane: Array | None) -> Bool[Array, " m"]:
    """(M,) bool: the fits that are accepted."""
    pitch = nearest_pitch(board.xy)
    move = np.linalg.norm(fit.xy - board.xy, axis=1)
    contrast = fit.state[:, CONTRAST] * (1 - 2.0 * (board.ij.sum(axis=1) % 2))
    typical = median(contrast)
    good = np.isfinite(fit.xy).all(axis=1) & np.isfinite(fit.cov).all(axis=(1, 2)) & (fit.kept > KEPT)
    good &= (move < FAR * pitch) | (board.status == Status.SEED) & (move < 2 * FAR * pitch)
    good &= contrast * np.sign(typical) > max(FAINT * abs(typical), NOTHING)
    good &= fit.variance < NOISY * median(fit.variance)
    return good & ~_astray(board, fit, good, plane)


def _astray(board: Board, fit: Fit, good: Bool[Array, " m"], plane: Array | None) -> Bool[Array, " m"]:
    """(M,) bool: outliers, whose fit lies further from the position predicted by the neighbours than the corner did
    before. Neighbours are taken where their `good` fits are, and, since some of them may err together, where they
    were."""
    fitted = np.where(good[:, None], fit.xy, board.xy)
    every, out = np.arange(len(fitted)), np.zeros(len(fitted), bool)
    for xy, slack in ((fitted, ASTRAY), (board.xy, TOGETHER)):
        alone = lattice(board.ij, xy, 0.0, plane)
        after, before = (np.linalg.norm(alone(every, at), axis=1) for at in (fitted, board.xy))
        out |= after > FURTHER * before + slack
    return out
