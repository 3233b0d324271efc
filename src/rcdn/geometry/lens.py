"""Lens models: pixels of camera points, and rays of pixels."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.correction import stereographic, surface
from rcdn.geometry.inverse import corrected_ray
from rcdn.geometry.models import distorted, undistorted
from rcdn.types import Array, Camera, Pose
from rcdn.types.arrays import Real


def transform(pose: Pose, points: Array) -> Real[Array, "... 3"]:
    """Board points (..., 3) in camera coordinates."""
    return np.asarray(points, float) @ pose.R.T + pose.t


def project(camera: Camera, points: Array) -> Real[Array, "... 2"]:
    """Camera points (..., 3) to pixels (..., 2). z ≤ 0 gives NaN (but for `fisheye` and a barrel of
    the `division` model, which see behind themselves).

    A `camera.correction` is added to the point that the lens model has distorted, before K. Beyond the fold of a lens polynomial
    the pixel is still the polynomial's, though no light from that point gets there: `unproject` gives another ray for it, or NaN.
    """
    points = np.asarray(points, float)
    with np.errstate(all="ignore"):  # as in `unproject`
        d = distorted(camera, points)
        if camera.correction is not None:
            d = d + surface(camera.correction, stereographic(points))
        return d @ camera.K[:2, :2].T + camera.K[:2, 2]


def unproject(camera: Camera, pixels: Array) -> Real[Array, "... 3"]:
    """Pixels (..., 2) to viewing rays (..., 3) of unit z (`fisheye` and `division`: unit length).

    Exact to 1e-10 where the lens model can be inverted, else NaN: beyond the fold, where the polynomial turns back, and
    where a `camera.correction` turns the picture over.
    """
    pixels = np.asarray(pixels, float)
    K = camera.K
    pixels = np.where(np.isfinite(pixels), pixels, np.nan)
    with np.errstate(all="ignore"):  # lenses of numbers that no lens has see nothing: NaN says it
        y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
        d = np.stack([(pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0], y], axis=-1)
        return undistorted(camera, d) if camera.correction is None else corrected_ray(camera, d)
