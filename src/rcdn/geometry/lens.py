"""Projection of camera points to pixels, and the inverse, viewing rays of pixels."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.correction import stereographic, surface
from rcdn.geometry.inverse import corrected_ray
from rcdn.geometry.models import pixels_of, undistorted
from rcdn.types import Array, Camera, Pose
from rcdn.types.arrays import Real


def transform(pose: Pose, points: Array) -> Real[Array, "... 3"]:
    """Board points (..., 3) transformed to camera coordinates by `pose`."""
    return np.asarray(points, float) @ pose.R.T + pose.t


def project(camera: Camera, points: Array) -> Real[Array, "... 2"]:
    """Camera points (..., 3) to pixels (..., 2). z ≤ 0 gives NaN, except for `fisheye` and a barrel distortion of the
    `division` model, whose field of view may exceed 180°.

    A `camera.correction` is added to the distorted point of the lens model, before K. Beyond the fold of a lens
    polynomial the pixel still follows the polynomial, although a real lens images no such point there: `unproject`
    gives another ray for this pixel, or NaN.
    """
    points = np.asarray(points, float)
    with np.errstate(all="ignore"):  # as in `unproject`
        shift = None if camera.correction is None else surface(camera.correction, stereographic(points))
        return pixels_of(camera, points, shift)


def unproject(camera: Camera, pixels: Array) -> Real[Array, "... 3"]:
    """Pixels (..., 2) to viewing rays (..., 3) of unit z (`fisheye` and `division`: unit length).

    Exact to 1e-10 where the lens model can be inverted, else NaN: beyond the fold, where the polynomial decreases, and
    where a `camera.correction` reverses the orientation of the map.
    """
    pixels = np.asarray(pixels, float)
    K = camera.K
    pixels = np.where(np.isfinite(pixels), pixels, np.nan)
    with np.errstate(all="ignore"):  # parameters that no real lens has give NaN, not a warning
        y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
        d = np.stack([(pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)
        return undistorted(camera, d) if camera.correction is None else corrected_ray(camera, d)
