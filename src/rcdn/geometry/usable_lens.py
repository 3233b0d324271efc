"""Validity of a camera's parameters, checked before anything is computed with them."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.lens import unproject
from rcdn.types import Camera
from rcdn.types.ranges import POSITION, coefficient_trouble, focal_trouble

ALONG = 9
"""grid points along each side of the frame at which rays are checked"""
DISPLACED = 100.0
"""focal lengths: largest valid displacement by a correction"""
EXTENT = (1e-6, 1e3)
"""valid range of a correction's half width in the stereographic plane, where the directions at 90° have radius 2"""


def lens_trouble(camera: Camera) -> str:
    """The reason why `camera` is unusable, with the field and its range; "" if it is usable.

    Its parameters must be finite and within `rcdn.types.ranges`, and some pixels of its frame must have a viewing ray.
    """
    if trouble := number_trouble(camera):
        return trouble
    x, y = (np.linspace(0, side - 1, ALONG) for side in camera.image_size)
    with np.errstate(all="ignore"):
        rays = unproject(camera, np.stack(np.meshgrid(x, y), axis=-1))
    seen = np.isfinite(rays).all(axis=-1).any()
    return "" if seen else "distortion: no pixel of the picture has a viewing ray under this lens"


def number_trouble(camera: Camera) -> str:
    """`lens_trouble` for the parameters alone, without the viewing rays."""
    K = camera.K
    if trouble := focal_trouble(K):
        return f"K: {trouble}"
    if not (np.abs(K[[0, 0, 1], [1, 2, 2]]) <= POSITION).all():
        return f"K: the principal point and the skew must be within ±{POSITION:g} px"
    if trouble := coefficient_trouble(camera.distortion):
        return f"distortion: {trouble}"
    if (found := camera.correction) is not None:
        if not (np.abs(found.control) <= DISPLACED).all():
            return f"correction: its control points must be finite and within ±{DISPLACED:g} focal lengths"
        if not ((found.extent >= EXTENT[0]) & (found.extent <= EXTENT[1])).all():
            return f"correction: its extent must be {EXTENT[0]:g} to {EXTENT[1]:g}, not {found.extent.tolist()}"
    return ""
