"""Pictures of which all but a few pixels differ by few grey levels: fog, exposures that are far too short, 16 bits that
a lamp or a hot spot stretches. Networks and fits know contrasts of usual pictures."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Shaped

FAINT = 24.0
"""grey levels between the two percentiles, up to which a picture is faint"""
PERCENTILES = 1.0, 99.0
LOW, HIGH = 28.0, 228.0
"""grey levels of the percentiles once the picture is stretched; what lies beyond is clipped"""


def stretched(grey: Shaped[Array, "h w"]) -> Shaped[Array, "h w"] | None:
    """The picture `grey` (H, W), 0..255, as uint8 with usual contrast, if it is faint; None if it isn't, or is
    constant."""
    low, high = (float(v) for v in np.percentile(grey, PERCENTILES, method="inverted_cdf"))
    if not 0 < high - low <= FAINT:
        return None
    levels = (grey.astype(np.float64) - low) * ((HIGH - LOW) / (high - low)) + LOW
    return np.asarray(np.rint(np.clip(levels, 0, 255)).astype(np.uint8))
