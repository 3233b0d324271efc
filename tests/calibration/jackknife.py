"""Standard deviations of a camera by leaving out one view at a time."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.influence import solved


def deviations(info):
    """(P,) standard deviations of the camera's parameters, by a jackknife over the views of `info`, linearised."""
    H, g = info.information.sum(axis=0) + info.prior, info.score.sum(axis=0)
    moved = solved(H - info.information, g - info.score) - solved(H, g)
    n = len(info)
    return np.sqrt((n - 1) / n * (moved**2).sum(axis=0))
