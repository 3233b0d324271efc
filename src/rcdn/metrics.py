"""Comparison of detections with the ground truth: matching, precision, recall, localisation error."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from rcdn.types import Array
from rcdn.types.arrays import Bool, Real


def match(found: Array, truth: Array, radius: float) -> tuple[Array, Array]:
    """One-to-one pairs closer than `radius` px, nearest first (greedy by distance, the strict protocol).

    `found` (N, 2), `truth` (M, 2). Returns index pairs (P, 2) into found and truth, and their distances (P,).
    """
    found, truth = np.asarray(found, float).reshape(-1, 2), np.asarray(truth, float).reshape(-1, 2)
    if not len(found) or not len(truth):
        return np.zeros((0, 2), int), np.zeros(0)
    near = cKDTree(found).sparse_distance_matrix(cKDTree(truth), radius, output_type="coo_matrix")
    order = np.lexsort((near.col, near.row, near.data))
    used_f: set[int] = set()
    used_t: set[int] = set()
    pairs, gaps = [], []
    for k in order:
        i, j, d = int(near.row[k]), int(near.col[k]), float(near.data[k])
        if i not in used_f and j not in used_t and d < radius:
            used_f.add(i)
            used_t.add(j)
            pairs.append((i, j))
            gaps.append(d)
    return np.array(pairs, int).reshape(-1, 2), np.array(gaps)


def within_radius(found: Array, truth: Array, radius: float) -> Bool[Array, " n"]:
    """(N,) True where a true corner is closer than `radius` px: as in the paper, a duplicate is a true positive."""
    found, truth = np.asarray(found, float).reshape(-1, 2), np.asarray(truth, float).reshape(-1, 2)
    if not len(found) or not len(truth):
        return np.zeros(len(found), bool)
    return np.asarray(cKDTree(truth).query(found)[0] < radius)


def precision_recall(scores: Array, hits: Array, total: int) -> tuple[Array, Array]:
    """Precision and recall (N,) of the k best-scored detections, k = 1..N, against `total` true corners."""
    order = np.argsort(-scores, kind="stable")
    true = np.cumsum(hits[order])
    return true / np.arange(1, len(true) + 1), true / max(total, 1)


def counted(found: Real[Array, "n 2"], truth: Array, blind: Array, radius: float, reach: float) -> Array:
    """`found` (N, 2) without detections closer than `reach` px to a `blind` spot (K, 2), unless a corner of `truth` is
    closer than `radius` px.

    Blind spots are corners whose detection counts neither as a true nor as a false positive.
    """
    if not len(blind) or not len(found):
        return found
    return found[(cKDTree(blind).query(found)[0] >= reach) | within_radius(found, truth, radius)]


def best_f1(scores: Array, hits: Array, total: int) -> dict[str, float]:
    """`f1`, `precision`, `recall` at the threshold `threshold` with the largest F1, and average precision `ap`.

    Detections of equal score are accepted or rejected together, since no threshold separates them.
    """
    if not len(scores):
        return {"f1": 0.0, "precision": 0.0, "recall": 0.0, "threshold": 0.0, "ap": 0.0}
    precision, recall = precision_recall(scores, hits, total)
    falling = np.sort(scores)[::-1]
    last = np.append(falling[1:] < falling[:-1], True)
    precision, recall, falling = precision[last], recall[last], falling[last]
    f1 = 2 * precision * recall / np.maximum(precision + recall, 1e-12)
    k = int(np.argmax(f1))
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    ap = float(np.sum(np.diff(np.concatenate([[0.0], recall])) * envelope))
    values = {"f1": f1[k], "precision": precision[k], "recall": recall[k], "threshold": falling[k], "ap": ap}
    return {name: round(float(v), 4) for name, v in values.items()}
