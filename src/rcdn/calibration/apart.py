"""Cameras of some of the views, each calibrated apart from the others, and how much they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.difference import camera_difference, common_grid
from rcdn.calibration.groups import FEWEST, describe
from rcdn.calibration.influence import ViewInformation, corners_of, of_state
from rcdn.calibration.shape import FUNCTIONS, shape_basis
from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.errors import RcdnError
from rcdn.types import Array, BoardView, Calibration, Camera

AGREEING = 0.75
"""share of the views that their own camera must rest on"""


@dataclass(frozen=True, eq=False)
class CameraGroup:
    """Pictures that belong together: their `names`, a short `label`, the `camera` of them alone with the standard deviations `std` (P,) of its
    parameters (a jackknife over the views), its RMS, px, and `views`, how many it rests on."""

    names: tuple[str, ...]
    label: str
    camera: Camera
    std: Array
    rms: float
    views: int


def calibrate_apart(
    calibration: Calibration, views: Sequence[BoardView], every: Sequence[BoardView], anew: bool = False
) -> CameraGroup | None:
    """The camera of `views` alone, of the same model; `anew`: from nothing, else from the common solution. None if there is none."""
    corners, sigma = corners_of(calibration, views, [np.ones(len(v), bool) for v in views])
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
    fit, corners = _fit(calibration, views, camera, T, corners, sigma)
    used = [k for k, reason in enumerate(fit.reasons) if not reason]
    if len(used) < FEWEST or len(used) < AGREEING * len(views):
        return None
    info = of_state(fit.state, corners, fit.weight)
    info = ViewInformation(info.score[used], info.information[used], info.prior)
    names = tuple(dict.fromkeys(v.name for v in views))
    others = [v.name for v in every if v.name not in names]
    rms = float(np.sqrt((fit.residuals[fit.used] ** 2).sum(axis=1).mean()))
    return CameraGroup(names, describe(names, others), fit.state.cameras[0], info.deviations(), rms, len(used))


def _fit(
    calibration: Calibration, views: Sequence[BoardView], camera: Camera, T: Array, corners: Corners3, sigma: Array
) -> tuple[robust.Fit, Corners3]:
    """The solution from `camera` and poses `T`, and its corners: with a shape of the board of its own, if the calibration has one, for that
    may have made up for what tells the views apart."""
    if calibration.shape is not None:
        ij, size = np.concatenate([v.ij for v in views]), calibration.shape.size
        known = np.repeat([v.settled for v in views], [len(v) for v in views])
        basis = np.where(known[:, None], shape_basis(ij, size), 0.0)
        corners = replace(corners, board=ij * calibration.spacing, basis=basis)
    state = State.mono(camera, T)
    state, noise = robust.rough_fit(state, corners, sigma, default_free(state))
    if calibration.shape is not None:
        state = replace(state, shape=np.zeros((len(FUNCTIONS), 3)))
    free = default_free(state, shape=True)
    return robust.fit(state, noise, corners, sigma, free, spacing=calibration.spacing), corners


def significance(groups: Sequence[CameraGroup]) -> Array:
    """(4,) the largest difference of two groups in fx, fy, cx and cy, in standard deviations of it."""
    pairs = [(a, b) for k, a in enumerate(groups) for b in groups[k + 1 :]]
    gaps = [np.abs(a.camera.parameters - b.camera.parameters) / np.hypot(a.std, b.std) for a, b in pairs]
    return np.asarray(np.max(gaps, axis=0)[:4])


def apart_by(first: Camera, second: Camera) -> float:
    """By how much two cameras of one picture size differ, px, RMS over the picture, after the best rotation; infinite if they share no rays."""
    try:
        return camera_difference(first, second, common_grid(first, second, longer=16)).rms
    except RcdnError:
        return float("inf")
