"""The picture without its light, for boards under hard shadows: local contrast in ratios, not in differences of levels.

Paper in the shadow of a fence may be as dark as ink in the sun, so that the edges of shadows are as strong as those of
squares, and these fade in the shadow. The logarithm of the levels less its local mean has the same step from ink to
paper in both: homomorphic filtering (Oppenheim, Schafer and Stockham, Nonlinear filtering of multiplied and convolved
signals, Proc. IEEE 56, 1968), with illumination as the slow factor.
"""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

DARK = 4.0
"""grey levels added before the logarithm, so that noise in the dark is not amplified"""
GAIN, MIDDLE = 90.0, 128
"""grey levels for a ratio of e, and the level of the local mean"""
SIDE, PASSES = 25, 3
"""px: side of the window of the local mean, and how often the mean is taken: like a Gaussian of 12.5 px"""
PARTS = 8
"""parts of a grey level in which logarithms are counted: integers, whose sums are the same on every processor"""

_LEVELS = np.rint(PARTS * GAIN * np.log(np.arange(256) + DARK)).astype(np.uint16)


def levelled(grey: Shaped[Array, "h w"]) -> Real[Array, "h w"]:
    """The picture `grey` (H, W) uint8 or float32 in 0..255 without its light, uint8."""
    levels = grey if grey.dtype == np.uint8 else np.rint(grey).astype(np.uint8)
    values = cv2.LUT(levels, _LEVELS)
    mean = values
    for _ in range(PASSES):
        mean = _mean(mean)
    step = values.astype(np.int32) - mean + (MIDDLE * PARTS + PARTS // 2)
    return np.asarray(np.clip(step // PARTS, 0, 255).astype(np.uint8))


def _mean(values: Real[Array, "h w"]) -> Real[Array, "h w"]:
    """The mean of `values` (H, W) uint16 over the window, rounded; by integers, since the rounding of OpenCV's own mean
    depends on the width of the processor's vectors."""
    sums = cv2.boxFilter(values, cv2.CV_32S, (SIDE, SIDE), normalize=False, borderType=cv2.BORDER_REFLECT)
    return ((sums + SIDE * SIDE // 2) // (SIDE * SIDE)).astype(np.uint16)
