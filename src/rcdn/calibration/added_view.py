"""Information of one additional view: its contribution to the camera with its own pose marginalised, and the resulting
covariance.

A view whose corners have the Jacobian J with respect to the camera's parameters and B with respect to the board's
motion, both divided by the corners' standard deviations, contributes the information JᵀJ − JᵀB (BᵀB)⁻¹ BᵀJ (the Schur
complement of its pose: Triggs et al., Bundle Adjustment, 2000, §6).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.candidates import frame_grid
from rcdn.calibration.influence import view_information
from rcdn.calibration.sight import out_of_sight
from rcdn.calibration.uncertainty import pixel_jacobians, projection_uncertainty
from rcdn.geometry import unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Real

NEGLIGIBLE = 1e-12
"""× the largest eigenvalue of a covariance with unit diagonal: directions below it have no freedom"""
BATCH = 256
"""views that are computed together"""
NORM = 4
"""exponent of the mean over the frame by which views are compared: near the largest variance, but it also rewards what
lowers those just below it (by the largest alone, greedy choices repeat one view: docs/log.md)"""


@dataclass(frozen=True, eq=False)
class Information:
    """Information of C views: `root` (C, M, P), whose square rootᵀ root is that on the camera's parameters; `reach`
    (C, 6, P), minus the derivative of the board's motion with respect to them; `own` (C, 6, 6), the covariance of that
    motion under a known camera."""

    root: Array
    reach: Array
    own: Array

    @classmethod
    def of(cls, camera: Camera, points: Real[Array, "c n 3"], weight: Real[Array, "c n"]) -> Information:
        """For views that see `points` (C, N, 3), m, camera coordinates, with `weight` (C, N), 1 / px; 0 where a point
        is not visible."""
        flat = points.reshape(-1, 3)
        _, by_camera, by_motion = pixel_jacobians(camera, flat)
        shape = (len(points), -1)
        scale = np.repeat(weight.reshape(-1), 2).reshape(*shape, 1)
        return cls.marginalised(*(np.nan_to_num(a.reshape(*shape, a.shape[2])) * scale for a in (by_camera, by_motion)))

    @classmethod
    def marginalised(cls, J: Real[Array, "c n p"], B: Real[Array, "c n 6"]) -> Information:
        """From the whitened Jacobians with respect to the parameters and to the board's motion, of C views."""
        own = np.linalg.pinv(B.transpose(0, 2, 1) @ B, rcond=1e-12, hermitian=True)
        reach = own @ (B.transpose(0, 2, 1) @ J)
        root = J - B @ reach
        if root.shape[1] > root.shape[2]:
            root = np.asarray(np.linalg.qr(root, mode="r"))
        return cls(root, reach, own)


@dataclass(frozen=True, eq=False)
class Prior:
    """The covariance of a calibration from `views` views, in independent parts: camera parameters = `root` (P, R) times
    R unit variables; mean motion of the boards = −`reach` (6, P) times the parameters' error, plus an independent error
    with covariance `own` (6, 6)."""

    root: Array
    reach: Array
    own: Array
    views: int

    @classmethod
    def of(cls, calibration: Calibration) -> Prior:
        """From `calibration.cov`; parameters that are held fixed have no freedom."""
        return cls.split(calibration.cov, len(calibration.camera.parameters), len(calibration.used_views))

    @classmethod
    def split(cls, cov: Real[Array, "k k"], P: int, views: int) -> Prior:
        """From the covariance `cov` (P + 6, P + 6) of P parameters and of the mean motion over `views` views."""
        unit = np.sqrt(np.maximum(np.diag(cov)[:P], 0))
        safe = np.where(unit > 0, unit, 1.0)
        values, vectors = np.linalg.eigh(cov[:P, :P] / np.outer(safe, safe))
        free = values > NEGLIGIBLE * values.max()
        root = safe[:, None] * vectors[:, free] * np.sqrt(values[free])
        inverse = (vectors[:, free] / np.sqrt(values[free])).T / safe
        reach = -(inverse.T @ (inverse @ cov[:P, P:])).T
        own = cov[P:, P:] - reach @ cov[:P, :P] @ reach.T
        return cls(root, reach, own, views)


def weight_of(calibration: Calibration) -> float:
    """1 / px: weight of a typical corner, whose variance is that of the median sigma plus that of the additional
    scatter."""
    sigma = np.concatenate([v.sigma[v.used] for v in calibration.used_views] or [np.zeros(0)])
    known = sigma[np.isfinite(sigma)]
    median_sigma = float(np.median(known)) if len(known) else 0.0
    return 1 / max(float(np.hypot(calibration.noise, median_sigma)), 1e-6)


def share_known(calibration: Calibration, prior: Prior) -> float:
    """Factor for the information of a view computed with independent corners, with which the used views together have
    the information that `calibration.cov` states: residuals of one view are correlated, so that a view contributes less
    than independent corners would."""
    if not any(v.used.any() for v in calibration.used_views) or any(v.pose is None for v in calibration.used_views):
        return 1.0
    total = view_information(calibration).information.sum(axis=0)
    ratio = float(np.trace(prior.root.T @ total @ prior.root)) / max(prior.root.shape[1], 1)
    return 1 / ratio if np.isfinite(ratio) and ratio > 0 else 1.0


def variances(
    prior: Prior, more: Information, by_camera: Real[Array, "g 2 p"], by_motion: Real[Array, "g 2 6"]
) -> Real[Array, "c g"]:
    """(C, G) px²: variance of projections at G points, mean of both axes, with each of C views added.

    `by_camera` (G, 2, P) and `by_motion` (G, 2, 6): derivatives of the projection. The mean motion is then that over
    one more view.
    """
    n, many = prior.views, len(by_camera)
    flat = by_motion.reshape(2 * many, 6)
    own = (n**2 * prior.own + more.own) / (n + 1) ** 2
    rows = (by_camera.reshape(2 * many, -1) - flat @ (n / (n + 1) * prior.reach)) @ prior.root
    moved, root = more.reach @ (prior.root / (n + 1)), more.root @ prior.root
    # variance of the projections with the Jacobian rows − flat moved, less what the view's corners tell of it
    # (Woodbury's identity)
    square = (rows**2).sum(axis=1) - 2 * np.einsum("cgm,gm->cg", rows @ moved.transpose(0, 2, 1), flat)
    square += np.einsum("cgm,gm->cg", flat @ (own + moved @ moved.transpose(0, 2, 1)), flat)
    told = root @ rows.T - (root @ moved.transpose(0, 2, 1)) @ flat.T
    lower = np.linalg.cholesky(np.eye(root.shape[1]) + root @ root.transpose(0, 2, 1))
    told = np.linalg.inv(lower) @ told  # faster than to solve it
    square -= np.einsum("cmg,cmg->cg", told, told)
    return np.asarray(np.maximum(square, 0.0).reshape(-1, many, 2).mean(axis=2))


@dataclass(frozen=True, eq=False)
class Outlook:
    """Uncertainties of projections, now and with one more view: `before`, the present worst one, px, and `level`, their
    NORM-mean, px; the covariance now, `prior`; derivatives of the G projections, `by_shared` (G, 2, P) and `by_motion`
    (G, 2, 6)."""

    prior: Prior
    by_shared: Array
    by_motion: Array
    before: float
    level: float

    def with_each(self, count: int, information: Callable[[slice], Information]) -> tuple[Array, Array]:
        """(C,) px, the worst uncertainty, and (C,) px, the NORM-mean: with each of `count` views, of which
        `information` tells that of a part."""
        parts = (information(slice(k, k + BATCH)) for k in range(0, count, BATCH))
        found = np.concatenate([variances(self.prior, more, self.by_shared, self.by_motion) for more in parts])
        return np.sqrt(found.max(axis=1)), level_of(found)

    def gain(self, level: Real[Array, " c"]) -> Real[Array, " c"]:
        """(C,) decrease of the logarithm of the NORM-mean to `level` (C,) px."""
        return np.asarray(np.log(self.level / np.maximum(level, 1e-12)))


@dataclass(frozen=True, eq=False)
class Forecast(Outlook):
    """Prediction of the projection uncertainty over the frame of `camera` with one more view; `weight` of a corner, 1 /
    px."""

    camera: Camera
    weight: float

    @classmethod
    def of(cls, calibration: Calibration) -> Forecast | None:
        """None if the covariance is unknown, or the lens has no ray."""
        points, by_camera, by_motion = judged_points(calibration.camera)
        if not len(points) or not np.isfinite(calibration.cov).all():
            return None
        prior = Prior.of(calibration)
        weight = weight_of(calibration) * float(np.sqrt(share_known(calibration, prior)))
        now = projection_uncertainty(calibration, points)
        before, level = float(np.nanmax(now)), float(level_of(now[None] ** 2)[0])
        return cls(prior, by_camera, by_motion, before, level, calibration.camera, weight)

    def after(self, points: Real[Array, "c n 3"], seen: Real[Array, "c n"]) -> tuple[Array, Array]:
        """(C,) px, the worst uncertainty, and (C,) px, the NORM-mean: with each of C views that see `points` (C, N, 3),
        m, camera coordinates; `seen` (C, N): number of corners that each point stands for, 0 where it is not visible.
        """
        return self.with_each(
            len(points), lambda part: Information.of(self.camera, points[part], self.weight * np.sqrt(seen[part]))
        )


def level_of(variances: Real[Array, "c g"]) -> Real[Array, " c"]:
    """(C,) px: root of the NORM-mean of `variances` (C, G) px², relative to the largest lest powers overflow."""
    worst = np.nanmax(variances, axis=1)
    return np.asarray(np.sqrt(worst * np.nanmean((variances / worst[:, None]) ** NORM, axis=1) ** (1 / NORM)))


def frame_rays(camera: Camera) -> tuple[Array, Array]:
    """Pixels (G, 2) over the visible part of the frame, and their unit rays (G, 3)."""
    points = frame_grid(camera.image_size)
    points = points[~np.logical_or(*out_of_sight(camera, points))]
    return points, unit(unproject(camera, points))


def judged_points(camera: Camera) -> tuple[Array, Array, Array]:
    """Points (G, 2) px over the visible part of the frame, with the derivatives of the projection of a distant point
    there with respect to the camera's parameters (G, 2, P) and to the boards' mean motion (G, 2, 6), as in
    `projection_uncertainty`."""
    points, rays = frame_rays(camera)
    _, by_camera, by_motion = pixel_jacobians(camera, rays, np.inf)
    return points, by_camera, by_motion
