"""Non-maximum suppression of equal boxes: exact greedy, in bounded time."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.config import Nms
from rcdn.types import Array


def candidates(response: Array, threshold: float, peaks: bool = False) -> Array:
    """Pixels of `response` (H, W) that are at least `threshold`, as (N, 2) integer (x, y), row by row.

    `peaks`: only those that none of their eight neighbours exceeds. NaN is never a candidate; a threshold of +inf leaves none.
    """
    if not np.isfinite(threshold):
        return np.zeros((0, 2), np.int64)
    high = response >= threshold
    if peaks and response.size:
        high &= response >= cv2.dilate(response, np.ones((3, 3), np.uint8))
    y, x = np.nonzero(high)
    return np.stack((x, y), axis=1)


def nms(response: Array, threshold: float, rule: Nms, limit: int = 20000) -> tuple[Array, Array]:
    """Candidates that survive greedy suppression by falling response, ties by (y, x).

    Paper section 3.3: boxes of one size (side `rule.box`, px) around the candidates; one that overlaps a stronger
    survivor by more than `rule.overlap` (intersection ÷ box area, as in the code of its predecessor CCDN) goes.
    Returns `xy` (N, 2) integer and `score` (N,), in that order. Only the `limit` strongest candidates compete, so
    that the time is bounded whatever the map shows; with fewer of them the result is that of plain greedy.
    """
    xy = candidates(response, threshold, rule.peaks)
    score = response[xy[:, 1], xy[:, 0]]
    strong = _strongest(score, limit)
    order = strong[np.argsort(-score[strong], kind="stable")]
    keep = order[_greedy(xy[order], response.shape, stencil(rule))]
    return xy[keep], score[keep]


def stencil(rule: Nms) -> Array:
    """Offsets that a survivor suppresses: boolean (2r + 1, 2r + 1), rows are dy, its own pixel in the middle."""
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


def _greedy(xy: Array, shape: tuple[int, ...], mask: Array) -> Array:
    """Indices of the survivors among `xy`, which come strongest first."""
    keep = np.ones(len(xy), bool)
    near = _near_others(xy, shape, mask)
    keep[near] = False
    keep[near[_greedy_among(xy[near], shape, mask)]] = True
    return np.flatnonzero(keep)


def _near_others(xy: Array, shape: tuple[int, ...], mask: Array) -> Array:
    """Indices of those within the mask of another one; most peaks stand alone."""
    reach = len(mask) // 2
    there = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), bool)
    x, y = xy.T + reach
    there[y, x] = True
    return np.flatnonzero(sum(there[y + dy, x + dx] for dy, dx in np.argwhere(mask) - reach) > 1)


def _greedy_among(xy: Array, shape: tuple[int, ...], mask: Array) -> list[int]:
    size, reach = len(mask), len(mask) // 2
    gone = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), bool)
    flags, keep = gone[reach:, reach:], []
    for index, (x, y) in enumerate(xy.tolist()):
        if not flags[y, x]:
            keep.append(index)
            gone[y : y + size, x : x + size] |= mask
    return keep
