"""Rectification of two cameras: both pictures turned so that what both see lies in the same rows (or, for cameras above
each other, columns)."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real


def rectifying(
    left: Camera, right: Camera, T: Real[Array, "4 4"]
) -> tuple[Real[Array, "3 3"], Real[Array, "3 3"], Real[Array, "3 4"], Real[Array, "3 4"], Real[Array, "4 4"]]:
    """R_left, R_right (3, 3), P_left, P_right (3, 4) and Q (4, 4) that rectify the pictures of two cameras to one
    plane, of the left one's size (Bouguet's method, OpenCV's stereoRectify). `T` (4, 4) takes left camera coordinates
    to right ones. Raises RcdnError for cameras at one place."""
    if not T[:3, 3].any():
        raise RcdnError("two cameras at one place can't be rectified; check the pair's translation")
    nothing = np.zeros(5)
    R_left, R_right, P_left, P_right, Q, *_ = cv2.stereoRectify(
        left.K,
        nothing,
        right.resized(left.image_size).K,  # it determines the focal length and the centre only
        nothing,
        left.image_size,
        T[:3, :3].copy(),
        T[:3, 3:].copy(),
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    return R_left, R_right, P_left, P_right, Q
