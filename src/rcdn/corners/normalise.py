"""What the networks see: grey levels freed from gain and offset. The same code in training and in inference."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.errors import ConfigError
from rcdn.types import Array

WINDOW = 25
FLOOR = 6.0
"""grey levels; keeps the noise of flat areas from being blown up"""


def normalise(grey: Array, kind: str) -> Array:
    """Normalised picture, (H, W) float32. `grey` (H, W) uint8 or float32, 0..255.

    `minmax`: the 0.1 and 99.9 percentiles go to 0 and 1 (hot pixels don't count).
    `local`: local contrast normalisation, (I − mean) / (std + 6) over 25×25 px.
    """
    if kind == "minmax":
        return minmax(grey)
    if kind == "local":
        return local_contrast(grey)
    raise ConfigError(f"normalisation must be 'minmax' or 'local', not {kind!r}")


def minmax(grey: Array) -> Array:
    """Linear stretch of the 0.1..99.9 percentiles to 0..1, not clipped. A flat picture becomes zeros."""
    if grey.dtype == np.uint8:
        share = np.cumsum(cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel()) / grey.size
        low, high = float(np.searchsorted(share, 0.001)), float(np.searchsorted(share, 0.999))
    else:
        low, high = (float(v) for v in np.percentile(grey, [0.1, 99.9], method="inverted_cdf"))
    scale = 1.0 / (high - low) if high > low else 0.0
    return np.asarray((grey.astype(np.float32) - np.float32(low)) * np.float32(scale))


def local_contrast(grey: Array) -> Array:
    """(I − mean) / (std + 6) over a 25×25 window, reflected at the border."""
    g = grey.astype(np.float32)
    size, border = (WINDOW, WINDOW), cv2.BORDER_REFLECT_101
    mean = cv2.boxFilter(g, cv2.CV_32F, size, borderType=border)
    square = cv2.sqrBoxFilter(g, cv2.CV_32F, size, borderType=border)
    std = np.sqrt(np.maximum(square - mean * mean, 0))
    return np.asarray((g - mean) / (std + np.float32(FLOOR)))
