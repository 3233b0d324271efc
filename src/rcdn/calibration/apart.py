"""Separate calibrations of groups of views, and the differences of their cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.board_points import has_shape, plane_of
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.difference import camera_difference, common_grid
from rcdn.calibration.groups import FEWEST, describe
from rcdn.calibration.influence import corners_of
from rcdn.calibration.shape import FEWEST_SHAPED, shape_basis
from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.errors import RcdnError
from rcdn.types import Array, BoardView, Calibration, Camera
from rcdn.types.arrays import Real

AGREEING = 0.75
"""least share of a group's views that its own calibration must use"""


@dataclass(frozen=True, eq=False)
class CameraGroup:
    """Pictures that belong together: their `names`, a short `label`, the `camera` from them alone with the standard
    deviations `std` (P,) of its parameters (from the scatter of whole views), its RMS, px, and `views`, the number of
    views that it uses."""

    names: tuple[str, ...]
    label: str
    camera: Camera
    std: Array
    rms: float
    views: int


def without_correction(calibration: Calibration) -> Calibration:
    """The calibration with the lens model alone: a smooth correction is a compromise if its views come from several
    cameras, and takes long to estimate."""
    camera = calibration.camera
    if camera.correction is None:
        return calibration
    many = len(calibration.cov)
    kept = np.r_[: camera.coefficients, many - 6 : many]
    return replace(calibration, camera=replace(camera, correction=None), cov=calibration.cov[np.ix_(kept, kept)])


def calibrate_apart(
    calibration: Calibration, views: Sequence[BoardView], every: Sequence[BoardView], anew: bool = False
) -> CameraGroup | None:
    """The camera from `views` alone, of the same model without a smooth correction; `anew`: without an initial guess,
    otherwise from the joint solution. None if it fails."""
    calibration = without_correction(calibration)
    corners, sigma, shaped = _corners(calibration, views)
    camera = calibration.camera
    seen = [Seen(corners.board[corners.frame == f], corners.xy[corners.frame == f]) for f in range(len(views))]
    if anew:
        rough = first_camera(seen, camera.image_size)
        T = poses(rough, seen)
        camera = Camera(rough.K, np.zeros(len(camera.distortion)), camera.image_size, camera.model)
    else:
        T = np.stack([v.pose.T_cam_board for v in views if v.pose is not None])
    if len(T) < FEWEST or not np.isfinite(T).all():
        return None
    state = State.mono(camera, T)
    state, noise = robust.initial_fit(state, corners, sigma, default_free(state))
    state = replace(state, shape=np.zeros((corners.basis.shape[1] if shaped else 0, 3)))
    free = default_free(state, shape=shaped)
    fit = robust.fit(state, noise, corners, sigma, free, spacing=calibration.spacing)
    used = [k for k, reason in enumerate(fit.reasons) if not reason]
    if len(used) < FEWEST or len(used) < AGREEING * len(views):
        return None
    names = tuple(dict.fromkeys(v.name for v in views))
    others = [v.name for v in every if v.name not in names]
    rms = float(np.sqrt((fit.residuals[fit.used] ** 2).sum(axis=1).mean()))
    std = np.sqrt(np.diag(fit.clustered.covariance)[: len(camera.parameters)])
    return CameraGroup(names, describe(names, others), fit.state.cameras[0], std, rms, len(used))


def _corners(calibration: Calibration, views: Sequence[BoardView]) -> tuple[Corners3, Array, bool]:
    """All corners of `views` on the perfect board, their sigma, and whether the board's shape is to be estimated, too:
    the calibration's shape is a compromise if its views come from several cameras."""
    every = [np.ones(len(v), bool) for v in views]
    corners, sigma = corners_of(replace(calibration, shape=None), views, every)
    if calibration.shape is None or sum(has_shape(calibration, v) for v in views) < FEWEST_SHAPED:
        return corners, sigma, False
    size = calibration.shape.size
    plane = plane_of(calibration)
    basis = [shape_basis(v.ij, size, plane) * has_shape(calibration, v) for v in views]
    return replace(corners, basis=np.concatenate(basis)), sigma, True


def significance(groups: Sequence[CameraGroup]) -> Real[Array, " 4"]:
    """(4,) the largest difference of two groups in fx, fy, cx and cy, divided by its standard deviation; 0 for what is
    held fixed."""
    pairs = [(a, b) for k, a in enumerate(groups) for b in groups[k + 1 :]]
    gaps = np.array([np.abs(a.camera.parameters - b.camera.parameters)[:4] for a, b in pairs])
    std = np.array([np.hypot(a.std, b.std)[:4] for a, b in pairs])
    return np.asarray(np.divide(gaps, std, out=np.zeros(gaps.shape), where=std > 0).max(axis=0))


def rms_of(groups: Sequence[CameraGroup]) -> float:
    """RMS over all `groups`, each under its own camera, px."""
    return float(np.sqrt(np.average([g.rms**2 for g in groups], weights=[g.views for g in groups])))


def apart_by(first: Camera, second: Camera) -> float:
    """Difference of two cameras of one picture size, px, RMS over the picture, after the best rotation; infinite if
    they share no rays."""
    try:
        return camera_difference(first, second, common_grid(first, second, longer=16)).rms
    except RcdnError:
        return float("inf")
