"""Local maxima of a likelihood map: non-maximum suppression shared by ChESS and Geiger's detector."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from rcdn.types import Array


def local_maxima(likelihood: Array, half: int, least: float) -> Array:
    """Pixels (N, 2) integer (x, y) of `likelihood` (H, W) float32 that are positive, at least `least`, and the largest
    of their window.

    The window is (2 half + 1)² px. Of equal ones in a window only the first is kept, row by row: a corner midway
    between pixels is one corner.
    """
    if not likelihood.size:
        return np.zeros((0, 2), np.int64)
    side = 2 * half + 1
    top = cv2.dilate(likelihood, np.ones((side, side), np.uint8))
    y, x = np.nonzero((likelihood > 0) & (likelihood >= least) & (likelihood >= top))
    xy = np.stack((x, y), axis=1)
    keep = np.ones(len(xy), bool)
    for i, j in sorted(cKDTree(xy).query_pairs(half, p=np.inf)) if len(xy) else ():
        keep[j] &= not keep[i]
    return xy[keep]
