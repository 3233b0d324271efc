"""Refinement and edge directions of the corners of deltilles: six sectors of alternating colour, where three edges
cross.

Half a turn about such a corner exchanges its colours. On a ring, the difference of opposite grey levels changes sign at
the three edges. Patterns that are even under half a turn (an X-corner, a bar) cancel, and a single edge changes the
sign only once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, Maxima, first_of_each
from rcdn.corners.orientation import HALF_TURN, MIN_CONTRAST, Orientation, sample_rings
from rcdn.corners.peaks import nearest_other
from rcdn.corners.refine import peak_offset
from rcdn.corners.symmetry import symmetry_centre
from rcdn.types import Array, Corners, Status
from rcdn.types.arrays import Bool, Real, Shaped

NARROWEST = 3
"""least width of a sector, in directions (11°): a deltille tilted by 75° has sectors this narrow"""
MIN_FIT = 0.45
"""below this `fit` there are no axes"""
SHARE = 0.45
"""radius of the disc of the refinement, share of the distance to the next corner"""
RANGE = (3, 12)
"""its limits, px"""
RING, RING_RANGE = 0.3, (3.0, 16.0)
"""radius of the rings, share of that distance, and its limits, px"""
RINGS = (0.8, 1.0, 1.2)
"""radii of the rings, × that of the corner"""
BATCH = 512
"""corners processed at a time: their data fits into a core's cache"""


@dataclass(frozen=True, eq=False)
class SixSectors(Orientation):
    """Orientation of N six-sector corners, as `Orientation` but with `axes` (N, 3).

    `even` (N,): share of the rings' variance in the part that is even under half a turn.
    """

    even: Array


def six_candidates(grey: Array, response: Array, found: Maxima, config: DetectorConfig) -> Candidates:
    """Refinement → orientation of all peaks, also the weak ones, which are few. `orientation.axes` is (N, 3)."""
    strong = found.strong(config)
    pitch = nearest_other(found.xy[strong], found.xy)
    fine, status = refine_six(grey, response, found.xy, pitch)
    once = first_of_each(fine, found.score)
    if found.rescued:
        status = np.where(status == Status.REFINED, Status.LOW_CONFIDENCE, status)
    order = once[np.lexsort((fine[once, 1], fine[once, 0], -found.score[once]))]
    fine, status, score, strong = fine[order], status[order], found.score[order], strong[order]
    seen = six_axes(grey, fine, ring(pitch[order]))
    return Candidates(Corners(fine, score, status), seen, strong & (score >= found.level), strong)


def ring(pitch: Real[Array, " n"]) -> Real[Array, " n"]:
    """Radius (N,) of the rings around corners whose neighbours are `pitch` (N,) px away."""
    return np.asarray(np.clip(RING * pitch, *RING_RANGE))


def refine_six(grey: Array, response: Array, xy: Shaped[Array, "n 2"], pitch: Real[Array, " n"]) -> tuple[Array, Array]:
    """Sub-pixel positions (N, 2) of six-sector corners near response peaks `xy` (N, 2), and their status (N,).

    First the Gaussian through the response (paper Eq. 4), then the centre of antisymmetry of a disc with a radius of
    0.45 `pitch` (N,), px, the distance to the next corner. Where there is none, `Status.SEED` and the position of the
    response's peak.
    """
    start = np.asarray(xy, np.float64)
    offset = peak_offset(response, np.rint(start).astype(np.int64)) if len(start) else np.zeros((0, 2))
    start = start + np.nan_to_num(offset)
    fine = antisymmetry(grey, start, pitch)
    failed = ~np.isfinite(fine).all(axis=1)
    fine[failed] = start[failed]
    return fine, np.where(failed, Status.SEED, Status.REFINED).astype(np.uint8)


def antisymmetry(grey: Array, start: Real[Array, "n 2"], pitch: Real[Array, " n"]) -> Real[Array, "n 2"]:
    """Centres of antisymmetry (N, 2) px near `start` (N, 2); NaN where there is none. `pitch` (N,) px as in
    `refine_six`."""
    fine = np.full((len(start), 2), np.nan)
    half = np.clip(np.rint(SHARE * np.nan_to_num(pitch, nan=20.0)), *RANGE).astype(int)
    for size in np.unique(half):
        mine = half == size
        fine[mine] = symmetry_centre(grey, start[mine], int(size), anti=True)
    return fine


def six_axes(grey: Shaped[Array, "h w"], xy: Real[Array, "n 2"], radius: Real[Array, " n"]) -> SixSectors:
    """The three edge directions of corners at `xy` (N, 2) px of `grey` (H, W), with contrast and colours.

    `radius` (N,) px, about 0.3 of the distance to the next corner. `axes` (N, 3) rising, radians in [0, π), NaN where
    there aren't three; `contrast` (N,) grey levels between sectors; `polarity` (N,): +1 where the sector from the first
    axis to the second is bright; `fit` (N,) in [0, 1]: share of the ring's variance that six sectors of two levels
    explain (a sine of three periods: 0.81); `even` (N,): share of the variance in the part that keeps its sign under
    half a turn.
    """
    xy = np.asarray(xy, np.float64).reshape(-1, 2)
    radius = np.broadcast_to(np.asarray(radius, np.float64), len(xy))
    parts = [
        _three(sample_rings(grey, xy[p], radius[p, None] * np.array(RINGS)).mean(axis=1))
        for p in (slice(i, i + BATCH) for i in range(0, len(xy), BATCH))
    ]
    if not parts:
        return SixSectors(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int8), np.zeros(0), np.zeros(0))
    axes, contrast, polarity, fit, even = (np.concatenate(column) for column in zip(*parts, strict=True))
    return SixSectors(axes, contrast, polarity, fit, even)


def _three(signal: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Axes, contrast, polarity, fit and even share from ring signals (N, 2 HALF_TURN)."""
    signal = signal.astype(np.float64)
    one, other = signal[:, :HALF_TURN], signal[:, HALF_TURN:]
    odd, even = (one - other) / 2, (one + other) / 2
    kept = ((even - even.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    energy = (odd**2).sum(axis=1) + kept
    plus, minus = _boundaries(odd), _boundaries(-odd)
    sign = np.where(plus[1] >= minus[1], 1, -1)
    bounds = np.where((sign > 0)[:, None], plus[0], minus[0])
    total = np.maximum(plus[1], minus[1])
    fit = np.divide(total**2, HALF_TURN * energy, out=np.zeros(len(odd)), where=energy > 0)
    contrast = 2 * total / HALF_TURN
    ok = (fit >= MIN_FIT) & (contrast >= MIN_CONTRAST) & _all_three(odd * sign[:, None], bounds, contrast)
    axes = _crossings(odd, bounds)
    turned = axes[:, 0] < 0  # an axis just below 0 becomes the last one, just below π
    axes = np.where(turned[:, None], np.column_stack([axes[:, 1:], axes[:, 0] + np.pi]), axes)
    polarity = np.where(ok, sign * np.where(turned, -1, 1), 0).astype(np.int8)
    return np.where(ok[:, None], axes, np.nan), contrast, polarity, np.minimum(fit, 1), kept / np.maximum(energy, 1e-9)


def _boundaries(odd: Array) -> tuple[Array, Array]:
    """Steps of the best two-level signal, bins (N, 3) a < b < c, and its correlation with `odd` (N, HALF_TURN).

    The signal is −1 before a, 1 from a to b, −1 from b to c, 1 after c; over the next half turn it is the negative of
    that. The correlation is W − 2 F(a) + 2 F(b) − 2 F(c) with F the running sum and W the total, so that it is
    maximised by dynamic programming: the best a before each b, then the best b before each c.
    """
    row = np.arange(len(odd))
    F = np.concatenate([np.zeros((len(odd), 1)), np.cumsum(odd, axis=1)[:, :-1]], axis=1)
    low, at_a = _running_best(-F)
    value, at_b = _running_best(np.concatenate([_nothing(odd), low[:, :-NARROWEST] + F[:, NARROWEST:]], axis=1))
    last = np.concatenate([_nothing(odd), value[:, :-NARROWEST] - F[:, NARROWEST:]], axis=1)
    c = last.argmax(axis=1)
    b = at_b[row, c - NARROWEST]
    a = at_a[row, b - NARROWEST]
    return np.stack([a, b, c], axis=1), odd.sum(axis=1) + 2 * last[row, c]


def _nothing(odd: Array) -> Array:
    return np.full((len(odd), NARROWEST), -np.inf)


def _running_best(values: Real[Array, "n k"]) -> tuple[Array, Array]:
    """Running maximum of `values` (N, K) along the columns, and the column where it occurs, (N, K) each."""
    best = np.maximum.accumulate(values, axis=1)
    new = np.concatenate([np.ones((len(values), 1), bool), values[:, 1:] > best[:, :-1]], axis=1)
    return best, np.maximum.accumulate(np.where(new, np.arange(values.shape[1]), 0), axis=1)


def _all_three(odd: Array, bounds: Array, contrast: Array) -> Bool[Array, " n"]:
    """(N,) bool: whether each of the three sectors is wide enough and has its colour, by at least a tenth of half the
    contrast."""
    a, b, c = bounds.T
    bins = np.arange(HALF_TURN)
    first = (bins >= a[:, None]) & (bins < b[:, None])
    second = (bins >= b[:, None]) & (bins < c[:, None])
    third = ~first & ~second
    shown = odd * np.where(first | (bins >= c[:, None]), 1.0, -1.0)
    means = [np.where(m, shown, 0).sum(axis=1) / np.maximum(m.sum(axis=1), 1) for m in (first, second, third)]
    return np.asarray((np.min(means, axis=0) > contrast / 20) & (third.sum(axis=1) >= NARROWEST))


def _crossings(odd: Array, bounds: Array) -> Real[Array, "n 3"]:
    """Directions (N, 3) of the zero crossings of `odd` at the bins `bounds`, by linear interpolation between
    samples."""
    row = np.arange(len(odd))[:, None]
    before = np.where(bounds == 0, -1, 1) * odd[row, (bounds - 1) % HALF_TURN]
    after = odd[row, bounds]
    inside = before * after < 0
    share = np.where(inside, before / np.where(inside, before - after, 1), 0.5)
    return np.asarray((bounds - 1 + share) * (np.pi / HALF_TURN))
