"""How far a camera is to be trusted: covariances, where projections go astray, where corners were."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.bundle import Arrow
from rcdn.errors import RcdnError
from rcdn.geometry import cross_matrix, project_with_slopes, unproject
from rcdn.types import Array, Calibration


def covariance(arrow: Arrow, frames: Array, scale: float) -> Array:
    """Covariance (K + 6, K + 6) of the K shared parameters and of the mean motion of the poses `frames` (F,) that were used.

    `scale`: mean square of the whitened residuals.
    """
    many = len(frames)
    shared = arrow.rim @ arrow.rim.T
    reach = arrow.reach[frames].mean(axis=0)
    own = np.einsum("fab,fcb->ac", arrow.own[frames], arrow.own[frames]) / many**2
    cross = -shared @ reach.T
    return np.asarray(scale * np.block([[shared, cross], [cross.T, own + reach @ shared @ reach.T]]))


def motion_covariance(arrow: Arrow, frame: int, scale: float) -> Array:
    """Covariance (6, 6) of one pose's small motion."""
    reach = arrow.reach[frame] @ arrow.rim
    return np.asarray(scale * (arrow.own[frame] @ arrow.own[frame].T + reach @ reach.T))


def projection_uncertainty(calibration: Calibration, pixels: Array, distance: float = np.inf) -> Array:
    """Standard deviation, px, of where the camera sees a fixed point that it sees at `pixels` (N, 2): root mean square of both axes.

    The point stands `distance` m away, in front of boards that hold still: camera and boards were estimated together, and a turn of
    all boards that a shift of the principal point makes up for is no error (mrcal's projection uncertainty, mean-pcam). NaN where
    the lens model has no ray. Of the noise of corners only: what the model can't follow isn't in it.
    """
    pixels = np.atleast_2d(np.asarray(pixels, float))
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise RcdnError(f"pixels must have shape (N, 2), not {pixels.shape}")
    if not distance > 0:
        raise RcdnError(f"distance must be positive, in metres, or infinite, not {distance}")
    rays = unproject(calibration.camera, pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.isfinite(rays).all(axis=1)
    _, by_point, by_camera = project_with_slopes(calibration.camera, rays[seen])
    turn = -by_point @ cross_matrix(rays[seen])
    shift = by_point / distance
    slopes = np.concatenate([by_camera, turn, shift], axis=2)
    variance = np.einsum("nia,ab,nib->n", slopes, calibration.cov, slopes, optimize=True) / 2
    out = np.full(len(pixels), np.nan)
    out[seen] = np.sqrt(variance)
    return out


def coverage(calibration: Calibration, cells: tuple[int, int] = (12, 9)) -> Array:
    """(rows, columns) how many used corners lie in each of `cells` (columns, rows) equal parts of the sensor."""
    width, height = calibration.camera.image_size
    corners = np.concatenate([v.xy[v.used] for v in calibration.used_views] or [np.zeros((0, 2))])
    edges = np.linspace(-0.5, height - 0.5, cells[1] + 1), np.linspace(-0.5, width - 0.5, cells[0] + 1)
    return np.asarray(np.histogram2d(corners[:, 1], corners[:, 0], bins=edges)[0].astype(int))
