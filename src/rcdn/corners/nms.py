"""Non-maximum suppression with boxes of equal size: exact greedy algorithm, in bounded time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.config import Nms
from rcdn.corners.sieve import every_cell
from rcdn.native import bind
from rcdn.types import Array, Warnings, allowed
from rcdn.types.arrays import Int, Real

ROOM = 4096
"""usual number of candidates: the first size of their array"""
MOST_CANDIDATES, MOST_PEAKS = 20_000, 125_000
"""largest number of candidates that compete; if only peaks are candidates, the largest number per megapixel: twice that
of a board with the smallest squares that the network resolves"""
_candidates = bind("rcdn_candidates")
_suppress = bind("rcdn_suppress")


def candidates(
    response: Real[Array, "h w"], threshold: float, peaks: bool = False, cells: Array | None = None
) -> Array:
    """Pixels of `response` (H, W) that are at least `threshold`, as (N, 2) integer (x, y), row by row.

    `peaks`: only pixels that none of their eight neighbours exceeds. NaN is never a candidate; a threshold of +inf
    gives none. `cells`: as in `find_maxima`; pixels outside of them are skipped, where that can't change the result.
    """
    if not np.isfinite(threshold):
        return np.zeros((0, 2), np.int64)
    response = np.ascontiguousarray(response, np.float32)
    cells = every_cell(response) if cells is None or threshold <= 0 else cells
    room = ROOM
    while True:
        xy = np.empty((room, 2), np.int64)
        count = _candidates(response, cells.view(np.uint8), threshold, peaks, xy)
        if count <= room:
            return xy[:count]
        room = count


def nms(
    response: Array,
    threshold: float,
    rule: Nms,
    limit: int | None = None,
    cells: Array | None = None,
    warnings: Warnings | None = None,
) -> tuple[Array, Array]:
    """Candidates that survive greedy suppression by falling response, ties by (y, x).

    Paper section 3.3: boxes of one size (side `rule.box`, px) around the candidates; one that overlaps a stronger
    survivor by more than `rule.overlap` (intersection ÷ box area, as in the code of its predecessor CCDN) is removed.
    Returns `xy` (N, 2) integer and `score` (N,), in that order. Only the `limit` strongest candidates compete (None:
    `MOST_CANDIDATES`, `MOST_PEAKS`), which bounds the time for any map; with no more candidates than that, the result
    is that of plain greedy suppression, with more a warning is added to `warnings`.
    """
    xy = candidates(response, threshold, rule.peaks, cells)
    if limit is None:
        limit = allowed(response.size, MOST_CANDIDATES, MOST_PEAKS) if rule.peaks else MOST_CANDIDATES
    if len(xy) > limit and warnings is not None:
        warnings.add("peaks", f"of {len(xy):,} places that may be corners only the {limit:,} strongest were looked at")
    score = response[xy[:, 1], xy[:, 0]]
    strong = _strongest(score, limit)
    order = strong[np.argsort(-score[strong], kind="stable")]
    keep = order[_greedy(xy[order], response.shape, stencil(rule))]
    return xy[keep], score[keep]


@lru_cache(maxsize=32)
def stencil(rule: Nms) -> Array:
    """Offsets at which a survivor suppresses others: boolean (2r + 1, 2r + 1), rows are dy, its own pixel in the
    middle."""
    side = rule.box - np.abs(np.arange(1 - rule.box, rule.box))
    mask = side[:, None] * side > rule.overlap * rule.box**2
    reach = np.abs(np.nonzero(mask.any(axis=0))[0] - (rule.box - 1)).max()
    middle = slice(rule.box - 1 - reach, rule.box + reach)
    return mask[middle, middle]


def _strongest(score: Array, limit: int) -> Array:
    """Indices, rising, of the `limit` largest scores; among equals the first ones."""
    if len(score) <= limit:
        return np.arange(len(score))
    level = np.partition(score, len(score) - limit)[len(score) - limit]
    above = np.nonzero(score > level)[0]
    equal = np.nonzero(score == level)[0][: limit - len(above)]
    return np.sort(np.concatenate((above, equal)))


def _greedy(xy: Int[Array, "n 2"], shape: tuple[int, ...], mask: Array) -> Array:
    """Indices of the survivors among `xy` (N, 2), which come strongest first."""
    keep = np.zeros(len(xy), np.uint8)
    _suppress(np.ascontiguousarray(xy, np.int64), *shape, mask.astype(np.uint8), keep)
    return np.flatnonzero(keep)
