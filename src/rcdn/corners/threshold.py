"""The response above which a pixel may be a corner: the rules of the paper's Table 2."""

from __future__ import annotations

import math
from typing import assert_never

import numpy as np

from rcdn.config import Adaptive, Fixed, MaxFraction, Std, Threshold
from rcdn.corners.sieve import every_cell
from rcdn.native import bind
from rcdn.types import Array

_above = bind("rcdn_above")


def threshold_value(response: Array, rule: Threshold, cells: Array | None = None) -> float:
    """The threshold of `rule` on a response map (H, W), in response units; pixels at or above it are candidates.

    Paper section 3.3 and Table 2: `Fixed` is a constant (MATE's 0.5), `Std` is Eq. (3) over all pixels, `MaxFraction`
    is linear in the largest response, `Adaptive` is the mean of the responses above its level. The paper does not
    define the threshold of a map without any such response: here it is +inf, so that there is no corner. The same
    holds, under the rules that depend on the map, for a map without any positive response. `cells`: as in
    `find_maxima`.
    """
    if isinstance(rule, Fixed):
        return float(rule.value)
    if isinstance(rule, Adaptive):
        return _adaptive(response, rule, cells)
    if response.size == 0 or not (peak := float(response.max())) > 0:
        return math.inf
    if isinstance(rule, MaxFraction):
        return rule.fraction * peak
    if isinstance(rule, Std):
        return float(response.mean(dtype="f8") + rule.factor * response.std(dtype="f8"))
    assert_never(rule)


def _adaptive(response: Array, rule: Adaptive, cells: Array | None) -> float:
    if not response.size or (rule.level < 0 and not response.max() > 0):
        return math.inf
    total = np.zeros(1)
    response = np.ascontiguousarray(response, np.float32)
    cells = every_cell(response) if cells is None or rule.level < 0 else cells
    count = _above(response, cells.view(np.uint8), rule.level, total)
    return float(total[0]) / count if count else math.inf
