"""How certain fitted positions are where pixels' errors are neither white nor alike.

JPEG, demosaicking and sharpening make errors of neighbouring pixels go together, and a model that doesn't quite fit
leaves residuals that are no noise at all. What counts is how much the pull of whole blocks of pixels on the position
varies. Misfit that is the same on both sides of the corner (a blur of another shape, ink, gamma) pulls opposite blocks
opposite ways and moves nothing: so blocks are summed with their mirror images.
"""

from __future__ import annotations

import numpy as np

from rcdn.precision.model import Windows
from rcdn.types import Array

SHARE = 3.0
"""blocks are a square's side divided by this, within `SIDES`"""
SIDES = (1.0, 8.0)
"""px"""
DOUBT = 0.15
"""standard deviation of the log of a board's measured factor"""
SPILL = 1.3
"""errors that go together don't stop at a block's rim: the true factor is the measured one to this power (low-passed noise, JPEG)"""
LOUD = 2.0
"""a corner whose own factor is this many times the board's is less certain than the board's others"""


def block_scores(w: Windows, unit: Array, residual: Array, weight: Array, slopes: Array) -> Array:
    """Sums (N, 2) over blocks of pixels: squared pulls on the position, and what white noise of variance 1 would give.

    `unit` (N, COUNT, COUNT) inverse normal matrix; `residual`, `weight` (N, P); `slopes` (N, COUNT, P). The fit makes the
    pulls of all blocks of a corner add up to nothing, which the second column allows for.
    """
    root = np.sqrt(weight)[:, None]
    lever = unit[:, :2].astype(np.float32) @ slopes * root
    index, size = _blocks(w)
    add = lambda a: np.bincount(index, a.ravel().astype(np.float64), len(a) * size).reshape(len(a), size)  # noqa: E731
    out = np.zeros((len(unit), 2))
    for k in (0, 1):
        share = add(lever[:, k] ** 2)
        out[:, 0] += (add(lever[:, k] * root[:, 0] * residual) ** 2).sum(axis=1)
        out[:, 1] += (share * (1 - share / np.maximum(share.sum(axis=1, keepdims=True), 1e-12))).sum(axis=1)
    return out


def _blocks(w: Windows) -> tuple[Array, int]:
    """Block of each pixel, flat (N · P,), numbered from corner to corner, and the number of blocks a corner."""
    pitch = float(np.median(1 / np.maximum(w.gu, w.gv)[w.weight > 0])) if (w.weight > 0).any() else 1.0
    count = np.maximum(w.weight.sum(axis=1, keepdims=True), 1)
    at = w.spot - (w.spot * w.weight).sum(axis=2, keepdims=True) / count
    x, y = np.rint(at / np.float32(np.clip(pitch / SHARE, *SIDES))).astype(np.int64)
    flip = np.where((y < 0) | ((y == 0) & (x < 0)), -1, 1)
    x, y = x * flip, y * flip
    reach = max(int(np.abs(x).max(initial=0)), int(y.max(initial=0))) + 1
    size = reach * (2 * reach + 1)
    own = y * (2 * reach + 1) + x + reach
    return (np.arange(len(own))[:, None] * size + own).ravel(), size


def spreads(scores: Array, variance: Array) -> Array:
    """Variance (N,) of the pull of a pixel, grey levels², that makes the normal matrix honest.

    `scores` (N, 2) from `block_scores`; `variance` (N,) of the residuals. One factor for the board, believed as far as it
    stands out from chance, and more for corners whose own stands out from the board's.
    """
    white = np.maximum(scores[:, 1] * variance, 1e-12)
    factor = max(float(scores[:, 0].sum() / white.sum()), 1e-3)
    log = float(np.log(factor))
    log *= (SPILL if log > 0 else 1.0) * log**2 / (log**2 + DOUBT**2)
    factor = float(np.exp(log))
    return np.asarray(variance * factor * np.maximum(1, scores[:, 0] / white / factor / LOUD))
