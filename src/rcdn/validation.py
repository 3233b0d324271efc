"""The fixed hard validation set and the score of a response map on it, used both in training and for the docs'
figures."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.config import Nms
from rcdn.corners.nms import nms
from rcdn.metrics import best_f1, match, within_radius
from rcdn.synthetic import HARD, Ranges, random_crop
from rcdn.types import Array

Score = tuple[Array, Array, Array, int]
"""score of each peak, whether it is a true positive, distances of the true positives (px), number of corners"""
COUNT, SIZE, FIRST, BORDER, RADIUS, DOUBT = 400, 144, 9_000_000_000, 8, 2.0, 4.0
"""400 crops of 144 px from the ranges HARD; an ignored margin of 8 px; matching radius of 2 px; ignored radius of 4 px
around doubtful corners"""


@lru_cache(maxsize=2)
def validation_set(count: int = COUNT, ranges: Ranges = HARD) -> tuple[tuple[Array, Array], ...]:
    """(picture, labels) of the fixed hard validation set; it contains no photographs, so that anyone can reproduce
    it."""
    return tuple(random_crop(FIRST + k, SIZE, ranges) for k in range(count))


def summary(scores: list[Score]) -> dict[str, float]:
    """F1 at the best threshold, its precision and recall, that threshold, average precision, and `pixel_error`.

    `pixel_error`: mean distance of the matched peaks from the exact corners, px; NaN if no peak matches.
    """
    peaks, hits, gaps = (np.concatenate([row[k] for row in scores]) for k in range(3))
    error = round(float(gaps.mean()), 4) if len(gaps) else float("nan")
    return best_f1(peaks, hits, sum(row[3] for row in scores)) | {"pixel_error": error}


def score_crop(response: Array, labels: Array, least: float = 0.05) -> Score:
    """(score of each peak, whether it is a true positive, distances of the true positives, number of corners) of one
    crop.

    Only the area within the margin counts: its corners with the peaks that match them, and its peaks that match no
    corner. A peak at a doubtful corner or at a corner in the margin is neither a true nor a false positive.
    """
    xy, score = nms(response, least, Nms(5))
    sure = labels[:, 2] > 0
    corners, doubtful = labels[sure, :2], labels[~sure, :2]
    counted = _inside(corners, response.shape)
    pairs, gaps = match(xy, corners, RADIUS)
    good = counted[pairs[:, 1]]
    hit, paired = np.zeros(len(xy), bool), np.zeros(len(xy), bool)
    hit[pairs[good, 0]], paired[pairs[:, 0]] = True, True
    keep = hit | (_inside(xy, response.shape) & ~paired & ~within_radius(xy, doubtful, DOUBT))
    return score[keep], hit[keep], gaps[good], int(counted.sum())


def _inside(xy: Array, shape: tuple[int, ...]) -> Array:
    """(N,) True where `xy` (N, 2) lies inside the margin of BORDER px."""
    return np.asarray(((xy >= BORDER) & (xy <= np.array(shape[::-1]) - 1 - BORDER)).all(axis=1))
