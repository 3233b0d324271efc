"""Whether the numbers of a camera are those of a lens at all, before anything is computed with them."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.lens import unproject
from rcdn.types import Camera
from rcdn.types.ranges import COEFFICIENT, FOCAL, POSITION

ALONG = 9
"""pixels along each side of the frame that are looked at"""
DISPLACED = 100.0
"""focal lengths: no correction moves a point by more"""
EXTENT = (1e-6, 1e3)
"""of a correction's domain, in the stereographic plane, whose whole half space is 2"""


def lens_trouble(camera: Camera) -> str:
    """Why nothing can be computed with `camera`, with the field and its range; "" if all is well.

    Its numbers must be finite and within `rcdn.types.ranges`, and some of its frame's pixels must have a viewing ray.
    """
    if trouble := number_trouble(camera):
        return trouble
    x, y = (np.linspace(0, side - 1, ALONG) for side in camera.image_size)
    with np.errstate(all="ignore"):
        rays = unproject(camera, np.stack(np.meshgrid(x, y), axis=-1))
    seen = np.isfinite(rays).all(axis=-1).any()
    return "" if seen else "distortion: no pixel of the picture has a viewing ray under this lens"


def number_trouble(camera: Camera) -> str:
    """`lens_trouble` of the numbers alone."""
    K = camera.K
    f, shift = K[[0, 1], [0, 1]], K[[0, 0, 1], [1, 2, 2]]
    if not ((f >= FOCAL[0]) & (f <= FOCAL[1])).all():
        return f"K: the focal lengths must be {FOCAL[0]:g} to {FOCAL[1]:g} px, not {f[0]:.6g} and {f[1]:.6g}"
    if not (np.abs(shift) <= POSITION).all():
        return f"K: the principal point and the skew must be within ±{POSITION:g} px"
    if not (np.abs(camera.distortion) <= COEFFICIENT).all():
        return f"distortion: its numbers must be finite and within ±{COEFFICIENT:g}, not {camera.distortion.tolist()}"
    if (found := camera.correction) is not None:
        if not (np.abs(found.control) <= DISPLACED).all():
            return f"correction: its control points must be finite and within ±{DISPLACED:g} focal lengths"
        if not ((found.extent >= EXTENT[0]) & (found.extent <= EXTENT[1])).all():
            return f"correction: its extent must be {EXTENT[0]:g} to {EXTENT[1]:g}, not {found.extent.tolist()}"
    return ""
