"""The fixed hard validation set, and how a response map scores on it: the same for training and for the docs' figures."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.config import Nms
from rcdn.corners.nms import nms
from rcdn.metrics import best_f1, match, nearest
from rcdn.synthetic import HARD, Ranges, random_crop
from rcdn.types import Array

Score = tuple[Array, Array, Array, int]
"""score of each peak, whether it hits, distances of the hits (px), number of corners"""
COUNT, SIZE, FIRST, BORDER, RADIUS, DOUBT = 400, 144, 9_000_000_000, 8, 2.0, 4.0
"""400 crops of 144 px of the ranges HARD; the rim of 8 px doesn't count; 2 px to match; 4 px around doubtful corners"""


@lru_cache(maxsize=2)
def validation_set(count: int = COUNT, ranges: Ranges = HARD) -> tuple[tuple[Array, Array], ...]:
    """(picture, labels) of the fixed hard validation set; no photographs in it, so that anybody can make it."""
    return tuple(random_crop(FIRST + k, SIZE, ranges) for k in range(count))


def summary(scores: list[Score]) -> dict[str, float]:
    """F1 at the best threshold, its precision and recall, that threshold, average precision, and `pixel_error`.

    `pixel_error`: mean distance of the peaks to the exact corners, px; NaN if no peak hits.
    """
    peaks, hits, gaps = (np.concatenate([row[k] for row in scores]) for k in range(3))
    error = round(float(gaps.mean()), 4) if len(gaps) else float("nan")
    return best_f1(peaks, hits, sum(row[3] for row in scores)) | {"pixel_error": error}


def score_crop(response: Array, labels: Array, least: float = 0.05) -> Score:
    """(score of each peak, whether it hits, distances of the hits, number of corners) of one crop.

    What counts is inside the rim: corners there with the peaks that match them, and peaks there that match none. A peak
    at a doubtful corner or at a corner in the rim is neither right nor wrong.
    """
    xy, score = nms(response, least, Nms(5))
    sure = labels[:, 2] > 0
    corners, doubtful = labels[sure, :2], labels[~sure, :2]
    counted = _inside(corners, response.shape)
    pairs, gaps = match(xy, corners, RADIUS)
    good = counted[pairs[:, 1]]
    hit, paired = np.zeros(len(xy), bool), np.zeros(len(xy), bool)
    hit[pairs[good, 0]], paired[pairs[:, 0]] = True, True
    keep = hit | (_inside(xy, response.shape) & ~paired & ~nearest(xy, doubtful, DOUBT))
    return score[keep], hit[keep], gaps[good], int(counted.sum())


def _inside(xy: Array, shape: tuple[int, ...]) -> Array:
    """Which of `xy` (N, 2) lie inside the rim."""
    return np.asarray(((xy >= BORDER) & (xy <= np.array(shape[::-1]) - 1 - BORDER)).all(axis=1))
