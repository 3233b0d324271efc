"""The response above which a pixel may be a corner: the rules of the paper's Table 2."""

from __future__ import annotations

import math

from rcdn.config import Adaptive, Fixed, MaxFraction, Std, Threshold
from rcdn.types import Array


def threshold_value(response: Array, rule: Threshold) -> float:
    """The threshold of `rule` on a response map (H, W), in response units; pixels at or above it are candidates.

    Paper section 3.3 and Table 2: `Fixed` is a constant (MATE's 0.5), `Std` is Eq. (3) over all pixels, `MaxFraction`
    is linear in the largest response, `Adaptive` is the mean of the responses above its level. The paper is silent
    about a map without any such response: there is no corner then, and the threshold is +inf. The same holds for a
    map without any positive response under the rules that follow the map.
    """
    if isinstance(rule, Fixed):
        return float(rule.value)
    if response.size == 0 or not (peak := float(response.max())) > 0:
        return math.inf
    if isinstance(rule, MaxFraction):
        return rule.fraction * peak
    if isinstance(rule, Std):
        return float(response.mean(dtype="f8") + rule.factor * response.std(dtype="f8"))
    return _adaptive(response, rule)


def _adaptive(response: Array, rule: Adaptive) -> float:
    above = response[response > rule.level]
    return float(above.mean(dtype="f8")) if above.size else math.inf
