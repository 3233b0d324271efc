"""Cameras of some of the views, each calibrated apart from the others, and how much they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import State, default_free
from rcdn.calibration.groups import FEWEST, describe
from rcdn.calibration.influence import ViewInformation, corners_of, of_state
from rcdn.calibration.sight import cell_centres
from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.geometry import project, rotation, unproject
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
    state = State.mono(camera, T)
    free = default_free(state)
    fit = robust.fit(*robust.rough_fit(state, corners, sigma, free), corners, sigma, free)
    used = [k for k, reason in enumerate(fit.reasons) if not reason]
    if len(used) < FEWEST or len(used) < AGREEING * len(views):
        return None
    info = of_state(fit.state, corners, fit.weight)
    info = ViewInformation(info.score[used], info.information[used], info.prior)
    names = tuple(dict.fromkeys(v.name for v in views))
    others = [v.name for v in every if v.name not in names]
    rms = float(np.sqrt((fit.residuals[fit.used] ** 2).sum(axis=1).mean()))
    return CameraGroup(names, describe(names, others), fit.state.cameras[0], info.deviations(), rms, len(used))


def significance(groups: Sequence[CameraGroup]) -> Array:
    """(4,) the largest difference of two groups in fx, fy, cx and cy, in standard deviations of it."""
    pairs = [(a, b) for k, a in enumerate(groups) for b in groups[k + 1 :]]
    gaps = [np.abs(a.camera.parameters - b.camera.parameters) / np.hypot(a.std, b.std) for a, b in pairs]
    return np.asarray(np.max(gaps, axis=0)[:4])


def camera_difference(first: Camera, second: Camera) -> float:
    """By how much two cameras of one picture size see the same rays apart, px, RMS over the picture, after the best rotation between them."""
    pixels = cell_centres(first.image_size, (16, 12)).reshape(-1, 2)
    rays = unproject(first, pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    other = unproject(second, pixels[: len(rays)])
    good = np.isfinite(other).all(axis=1)
    if good.sum() < FEWEST:
        return float("inf")
    here = project(first, rays)
    turn = np.zeros(3)
    for _ in range(5):
        moved = rays @ rotation(turn).T
        gap = project(second, moved) - here
        seen = np.isfinite(gap).all(axis=1)
        steps = [project(second, moved @ rotation(1e-6 * e).T) - here - gap for e in np.eye(3)]
        J = np.stack(steps, axis=-1)[seen].reshape(-1, 3) / 1e-6
        change, *_ = np.linalg.lstsq(J, -gap[seen].ravel(), rcond=None)
        turn = turn + change
    gap = project(second, rays @ rotation(turn).T) - here
    return float(np.sqrt(np.nanmean((gap**2).sum(axis=1))))
