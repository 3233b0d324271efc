"""A provisional camera from a prior, refined by the first one or two views of a board.

A Gaussian prior on focal length, principal point and distortion, and the maximum a posteriori estimate from the
available views. It is accurate enough to plan the first views (where the board must be held), and is replaced as soon
as the views alone determine a camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from rcdn.calibration.bundle import Corners3, Prior, State, default_free, residuals
from rcdn.calibration.coded import Geometries, Spacing
from rcdn.calibration.labels import Labelled, Size
from rcdn.calibration.solver import Normal, solve
from rcdn.calibration.start import Seen, poses
from rcdn.calibration.uncertainty import Clustered, covariance
from rcdn.calibration.usable import FEWEST_CORNERS, board_view, sigma_of
from rcdn.geometry.cut import in_line
from rcdn.types import Array, Board, Calibration, Camera, CameraModel, ModelScore, Pose

MODELS: tuple[tuple[CameraModel, int], ...] = (("brown", 5), ("fisheye", 4))
"""lens models and the number of their coefficients: a normal lens, and a wide-angle one"""
FOCALS = (0.8, 0.45, 1.4)
"""initial focal lengths, in widths of the frame; the first is the prior's mean"""
FOCAL, ASPECT, CENTRE = 0.4, 0.02, 0.05
"""prior standard deviations: of the focal length (relative), of fy ÷ fx, of the principal point as a share of the
width"""
RADIAL, TANGENTIAL = 0.3, 0.01
"""prior standard deviations of the radial and the tangential coefficients"""
SCATTER = 0.2
"""px along one axis, the assumed noise of corners: there is no estimate of it yet"""


def first_guess(
    image_size: tuple[int, int], boards: Sequence[Board], names: Sequence[str], spacing: Spacing, size: Size | None
) -> Calibration:
    """The maximum a posteriori camera from a prior and `boards` (possibly none), as a calibration with the posterior
    covariance.

    `image_size` (width, height) px; `spacing` m and `size` as in `calibrate`. Boards that cannot be used are left out.
    """
    seen, labels, kept = _seen(boards, spacing, size)
    side = labels[0].spacing if labels else spacing if isinstance(spacing, float) else next(iter(spacing.values()))
    fits = [
        _fit(image_size, model, many, focal, seen, [sigma_of(boards[k]) for k in kept])
        for model, many in MODELS
        for focal in (FOCALS if seen else FOCALS[:1])
    ]
    best = min(fits, key=lambda f: f.cost)
    arrow = Normal.of(best.state, best.corners, best.weight, default_free(best.state)).arrow()
    frames = np.arange(len(seen))
    by_noise = Clustered(arrow.covariance, 1.0)
    # without boards, their mean motion has no uncertainty
    cov = covariance(arrow, frames, 1.0, by_noise) if seen else block_diag(arrow.covariance, np.zeros((6, 6)))
    gaps = residuals(best.state, best.corners)
    views = tuple(
        board_view(
            boards[k],
            label,
            names[k],
            pose=Pose(best.state.poses[f]),
            residuals=gaps[best.corners.frame == f],
            used=np.ones(len(boards[k]), bool),
        )
        for f, (k, label) in enumerate(zip(kept, labels, strict=True))
    )
    camera = best.state.cameras[0]
    return Calibration(camera, side, views, cov, SCATTER, (ModelScore(camera.model, float("nan"), float("nan")),))


def nominal(image_size: tuple[int, int], model: CameraModel, many: int, focal: float) -> Camera:
    """A camera with a focal length of `focal` widths of the frame and a lens of `many` coefficients, all zero."""
    width, height = image_size
    K = np.array([[focal * width, 0, (width - 1) / 2], [0, focal * width, (height - 1) / 2], [0, 0, 1]])
    return Camera(K, np.zeros(many), image_size, model)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A `state` fitted to `corners` with `weight` (N,) 1 / px; `cost`, twice the negative logarithm of its posterior
    density."""

    state: State
    corners: Corners3
    weight: Array
    cost: float


def _seen(boards: Sequence[Board], spacing: Spacing, size: Size | None) -> tuple[list[Seen], list[Labelled], list[int]]:
    """The usable boards, their labels, and their indices."""
    if not boards:
        return [], [], []
    every = Geometries.of(boards, spacing, size).labelled(boards, strict=False)
    kept = [
        k
        for k, (b, label) in enumerate(zip(boards, every, strict=True))
        if not label.reason and len(b) >= FEWEST_CORNERS and not in_line(b.ij, b.xy)
    ]
    return [Seen(every[k].places, boards[k].xy) for k in kept], [every[k] for k in kept], kept


def _fit(
    image_size: tuple[int, int], model: CameraModel, many: int, focal: float, seen: list[Seen], sigma: list[Array]
) -> _Fit:
    camera = nominal(image_size, model, many, focal)
    prior = camera_prior(image_size, model, many)
    T = poses(camera, seen) if seen else np.zeros((0, 4, 4))
    T[~np.isfinite(T).all(axis=(1, 2))] = np.eye(4)
    state = replace(State.mono(camera, T), prior=prior)
    frame = np.repeat(np.arange(len(seen)), [len(s.xy) for s in seen])
    empty = np.zeros((0, 2))
    corners = Corners3(
        frame,
        0 * frame,
        np.concatenate([s.board for s in seen] or [empty]),
        np.concatenate([s.xy for s in seen] or [empty]),
        np.zeros((len(frame), 0)),
    )
    scatter = np.nan_to_num(np.concatenate([*sigma, empty[:, 0]]))
    weight = 1 / np.hypot(SCATTER, scatter)
    if seen:
        state = solve(state, corners, weight, default_free(state)).state
    gaps = np.nan_to_num(residuals(state, corners), nan=1e3) * weight[:, None]
    return _Fit(state, corners, weight, float((gaps**2).sum()) + prior.cost(state.values))


def camera_prior(image_size: tuple[int, int], model: CameraModel, many: int) -> Prior:
    """The prior of a camera with a lens of `many` coefficients."""
    camera = nominal(image_size, model, many, FOCALS[0])
    focal, width = camera.K[0, 0], camera.image_size[0]
    names = camera.parameter_names[4:]
    lens = [TANGENTIAL if name.startswith("p") else RADIAL for name in names]
    deviations = [FOCAL * focal, FOCAL * focal, CENTRE * width, CENTRE * width, *lens]
    precision = np.diag(1 / np.square(deviations))
    precision[:2, :2] += np.array([[1, -1], [-1, 1]]) / (ASPECT * focal) ** 2
    return Prior(camera.parameters.copy(), precision)
