"""Clustering of candidates: k-means++ that drops small clusters (paper section 3.3)."""

from __future__ import annotations

import numpy as np

from rcdn.config import Cluster
from rcdn.types import Array
from rcdn.types.arrays import Int, Real, Shaped

STARTS = 10
"""runs of k-means++, of which the best counts"""
ITERATIONS = 100
"""steps of a run, at most"""


def cluster_mask(xy: Shaped[Array, "n 2"], rule: Cluster) -> Array:
    """(N,) bool: the candidates `xy` (N, 2) px that are kept; False in clusters of at most `rule.drop` points.

    Paper section 3.3: k-means++ on the positions; candidates far from the board form small clusters of their own. All
    stay if there are fewer than `rule.least`. The best of ten initialisations is used, drawn with the seed `rule.seed`,
    so that the result depends only on the input. Seeding is greedy, as in scikit-learn (departure P12): plain k-means++
    ends in worse optima, in which two corners of a board may be a cluster of their own. Known weakness: a true corner
    in a small cluster is dropped, too.
    """
    if len(xy) < rule.least or len(xy) == 0:
        return np.ones(len(xy), bool)
    label = kmeans(np.asarray(xy, np.float64), min(rule.k, len(xy)), rule.seed)
    return np.bincount(label)[label] > rule.drop


def kmeans(xy: Real[Array, "n 2"], k: int, seed: int) -> Int[Array, " n"]:
    """Labels (N,) of the best (smallest sum of squares) of `STARTS` k-means++ runs on `xy` (N, 2)."""
    rng = np.random.default_rng(seed)
    runs = [_lloyd(xy, _plus_plus(xy, k, rng)) for _ in range(STARTS)]
    return min(runs, key=lambda run: run[1])[0]


def _squared(xy: Array, centres: Array) -> Array:
    return ((xy[:, None] - centres) ** 2).sum(axis=2)


def _plus_plus(xy: Array, k: int, rng: np.random.Generator) -> Array:
    """k-means++ seeding (Arthur and Vassilvitskii 2007), greedy: each next centre is the best of a few points that are
    drawn by squared distance, the one that leaves the smallest sum of squares."""
    picks = [int(rng.integers(len(xy)))]
    nearest = _squared(xy, xy[picks])[:, 0]
    while len(picks) < k and nearest.sum() > 0:  # zero if every distinct point is already a centre
        drawn = rng.choice(len(xy), size=2 + int(np.log(k)), p=nearest / nearest.sum())
        left = np.minimum(nearest[:, None], _squared(xy, xy[drawn]))
        best = int(left.sum(axis=0).argmin())
        picks.append(int(drawn[best]))
        nearest = left[:, best]
    return xy[picks]


def _lloyd(xy: Array, centres: Array) -> tuple[Array, float]:
    """Labels and sum of squares after Lloyd's iterations; a centre that loses all its points stays where it is."""
    label = np.full(len(xy), -1)
    for _ in range(ITERATIONS):
        squared = _squared(xy, centres)
        moved, label = label, squared.argmin(axis=1)
        if np.array_equal(moved, label):
            break
        count = np.bincount(label, minlength=len(centres))[:, None]
        total = np.stack([np.bincount(label, axis, len(centres)) for axis in xy.T], axis=1)
        centres = np.where(count > 0, total / np.maximum(count, 1), centres)
    return label, float(squared[np.arange(len(xy)), label].sum())
