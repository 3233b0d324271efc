"""Pictures of which all but a few pixels differ by few grey levels: fog, exposures that are far too short, 16 bits that
a lamp or a hot spot stretches. Networks and fits know contrasts of usual pictures."""

from __future__ import annotations

import numpy as np

from rcdn.corners.normalise import levels
from rcdn.types import Array
from rcdn.types.arrays import Shaped

FAINT = 24.0
"""grey levels between the two limits, up to which a picture is faint"""
BEYOND = 0.01
"""share of the pixels below the lower limit, and above the upper one"""
LOW, HIGH = 28.0, 228.0
"""grey levels of the limits once the picture is stretched; what lies far beyond is clipped"""


def stretched(grey: Shaped[Array, "h w"]) -> Shaped[Array, "h w"] | None:
    """The picture `grey` (H, W), 0..255, as uint8 with usual contrast, if it is faint; None if it isn't, or is
    constant."""
    low, high = levels(grey, BEYOND)
    if not 0 < high - low <= FAINT:
        return None
    usual = (grey.astype(np.float64) - low) * ((HIGH - LOW) / (high - low)) + LOW
    return np.asarray(np.rint(np.clip(usual, 0, 255)).astype(np.uint8))
