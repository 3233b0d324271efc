"""Approximation of a camera by a simpler lens model, for programs that support distortion coefficients only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.jacobians import project_with_jacobian
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.rigid import unit
from rcdn.geometry.spline_grid import frame_pixels
from rcdn.types import LENS, Array, Camera, CameraModel

ALONG = 41
"""grid points along each side of the frame, to which the lens is fitted"""
CENTRAL = 80.0
"""degrees from the optical axis; the models pinhole, brown and rational aren't fitted to a frame with rays beyond it"""
HELD = 1e-3
"""px; contribution of a denominator coefficient of 1 of a rational lens to the minimised RMS (a zero prior)"""
WORTH = 0.8
"""A model with more coefficients is chosen if it lowers the residual to this share."""


def best_coefficients(camera: Camera, model: CameraModel, many: int | None = None) -> tuple[Camera, float, float]:
    """The camera of another lens model, with `many` distortion coefficients (None: all of the model's), whose
    projection of the frame's rays is closest to their pixels, by least squares over a grid; and the RMS and the largest
    length of the residuals over that grid, px.

    Both numbers are infinite if the model can't represent the frame, because its rays are too far from the optical axis
    or the best fit is folded there, or if nearly no pixel has a ray. Raises RcdnError for the model `division`, and if
    the camera has no rays.
    """
    if model == "division":
        raise RcdnError("best_coefficients: model can't be 'division'; use pinhole, brown, rational or fisheye")
    pixels, rays = _frame(camera)
    start = _start(camera, model, len(LENS[model]) if many is None else many)
    if 2 * len(rays) < len(start.parameters):
        return start, float("inf"), float("inf")
    if model != "fisheye" and (rays[:, 2] < np.cos(np.radians(CENTRAL)) * np.linalg.norm(rays, axis=1)).any():
        return start, float("inf"), float("inf")
    found = _fit(start, rays, pixels)
    gap = np.linalg.norm(project(found, rays) - pixels, axis=1)
    back = unproject(found, project(found, rays))
    if not (np.linalg.norm(unit(back) - unit(rays), axis=1) < 1e-6).all():
        return found, float("inf"), float("inf")
    return found, float(np.sqrt((gap**2).mean())), float(gap.max())


def nearest_camera(camera: Camera, models: Sequence[tuple[CameraModel, int]]) -> tuple[Camera, float, float]:
    """The best result of `best_coefficients` over several models, each with its number of coefficients, the simplest
    first: a later one is chosen if its RMS is below WORTH times the best so far. Raises RcdnError if none can represent
    the frame."""
    best = best_coefficients(camera, *models[0])
    for model, many in models[1:]:
        found = best_coefficients(camera, model, many)
        best = found if found[1] < WORTH * best[1] else best
    if not np.isfinite(best[1]):
        raise RcdnError(f"no lens of the models {', '.join(m for m, _ in models)} can show what this camera sees")
    return best


def _frame(camera: Camera) -> tuple[Array, Array]:
    """Pixels (N, 2) over the frame that have rays, and the rays (N, 3)."""
    pixels = frame_pixels(camera.image_size, ALONG)
    rays = unproject(camera, pixels)
    seen = np.isfinite(rays).all(axis=1)
    if not seen.any():
        raise RcdnError("best_coefficients: no pixel of the camera has a ray; calibrate it first")
    return pixels[seen], rays[seen]


def _start(camera: Camera, model: CameraModel, many: int) -> Camera:
    """Initial guess: the camera's own parameters as far as both models have them, zero for the others."""
    distortion = np.zeros(many)
    if (camera.model == "fisheye") == (model == "fisheye"):
        common = min(many, len(camera.distortion), 5 if camera.model != model else many)
        distortion[:common] = camera.distortion[:common]
    K = camera.K.copy()
    K[0, 1] = 0
    return Camera(K, distortion, camera.image_size, model)


def _fit(start: Camera, rays: Array, pixels: Array) -> Camera:
    """Least-squares fit; a weak zero prior keeps the denominator of a rational lens small, since numerator and
    denominator may share a factor."""
    from scipy.optimize import least_squares

    held = np.arange(9, 12) if start.model == "rational" else np.arange(0)
    firm = HELD * np.sqrt(len(rays))
    prior = np.zeros((len(held), len(start.parameters)))
    prior[np.arange(len(held)), held] = firm

    def residuals(parameters: Array) -> Array:
        gap = (project(start.with_parameters(parameters), rays) - pixels).ravel()
        return np.concatenate([gap, firm * parameters[held]])

    def jacobian(parameters: Array) -> Array:
        jacobian = project_with_jacobian(start.with_parameters(parameters), rays)[2]
        return np.concatenate([jacobian.reshape(-1, jacobian.shape[2]), prior])

    found = least_squares(residuals, start.parameters, jacobian, method="lm", x_scale="jac", max_nfev=200)
    return start.with_parameters(found.x)
