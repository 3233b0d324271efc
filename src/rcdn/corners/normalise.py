"""Normalisation of the networks' input, which removes gain and offset of the grey levels. Training and inference use
the same code."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.types import Array
from rcdn.types.arrays import Real, Shaped

KINDS = ("minmax", "local")
WINDOW = 25
"""px, side of the window of local contrast"""
FLOOR = 6.0
"""grey levels, added to the standard deviation so that the noise of flat areas is not amplified"""


STEP = np.float32(256)
"""floats are rounded to 1/256 grey level, so that sums over windows are exact and do not depend on a tile's origin"""


@dataclass(frozen=True)
class Normaliser:
    """Maps the grey levels of a picture, or of any part of it, to a network's input.

    `reach`: margin around a part on which its result depends, px; `low`, `high`: levels of the whole picture that map
    to 0 and 1 (`minmax`).
    """

    kind: str
    reach: int
    low: float = 0.0
    high: float = 0.0

    def __call__(self, part: Array) -> Array:
        """Normalised (H, W) float32. `part` (H, W) uint8 or float32, 0..255, extended by reflection at its border."""
        if self.kind == "local":
            return _local_contrast(part)
        scale = 1.0 / (self.high - self.low) if self.high > self.low else 0.0
        return np.asarray((part.astype(np.float32) - np.float32(self.low)) * np.float32(scale))


def normaliser(grey: Shaped[Array, "h w"], kind: str) -> Normaliser:
    """The normaliser of a picture `grey` (H, W).

    `minmax`: the 0.1 and 99.9 percentiles map to 0 and 1 (which ignores hot pixels), without clipping; a flat picture
    becomes zeros. `local`: local contrast normalisation, (I − mean) / (std + 6) over 25×25 px. Raises ConfigError for
    any other kind.
    """
    if kind == "minmax":
        return Normaliser(kind, 0, *levels(grey, 0.001))
    if kind == "local":
        return Normaliser(kind, WINDOW // 2)
    raise ConfigError(f"normalisation must be 'minmax' or 'local', not {shown(kind)}")


def normalise(grey: Array, kind: str) -> Real[Array, "h w"]:
    """The whole picture normalised, (H, W) float32; see `normaliser`."""
    return normaliser(grey, kind)(grey)


def levels(grey: Array, beyond: float) -> tuple[float, float]:
    """The grey levels below and above which there is a share `beyond` of the pixels each."""
    if grey.dtype == np.uint8:
        share = np.cumsum(cv2.calcHist([grey], [0], None, [256], [0, 256]).ravel()) / grey.size
        return float(np.searchsorted(share, beyond)), float(np.searchsorted(share, 1 - beyond))
    low, high = np.percentile(grey, [100 * beyond, 100 * (1 - beyond)], method="inverted_cdf")
    return float(low), float(high)


def _local_contrast(grey: Array) -> Array:
    g = grey.astype(np.float32)
    if grey.dtype != np.uint8:
        g = np.rint(g * STEP) / STEP
    size, border = (WINDOW, WINDOW), cv2.BORDER_REFLECT_101
    mean = cv2.boxFilter(g, cv2.CV_32F, size, borderType=border)
    square = cv2.sqrBoxFilter(g, cv2.CV_32F, size, borderType=border)
    std = np.sqrt(np.maximum(square - mean * mean, 0))
    return np.asarray((g - mean) / (std + np.float32(FLOOR)))
