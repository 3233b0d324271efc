"""Matching, precision, recall and F1 against brute force and by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.metrics import best_f1, match, precision_recall, within_radius


def brute_match(found, truth, radius):
    """All pairs, nearest first, each point once."""
    gap = np.linalg.norm(found[:, None] - truth[None], axis=2)
    pairs = []
    for i, j in sorted(np.ndindex(gap.shape), key=lambda p: (gap[p], p)):
        if gap[i, j] < radius and i not in {p[0] for p in pairs} and j not in {p[1] for p in pairs}:
            pairs.append((i, j))
    return pairs, [gap[p] for p in pairs]


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    n=st.integers(0, 12), m=st.integers(0, 12), radius=st.sampled_from([1.0, 2.0, 5.0]),
    lattice=st.booleans(), seed=st.integers(0, 10**6),
)  # fmt: skip
def test_match_is_brute_force(n, m, radius, lattice, seed):
    """On a lattice many distances are equal, or zero, or just the radius."""
    rng = np.random.default_rng(seed)
    found, truth = rng.uniform(0, 8, (n, 2)), rng.uniform(0, 8, (m, 2))
    if lattice:
        found, truth = np.rint(found), np.rint(truth)
    pairs, gaps = match(found, truth, radius)
    expected = brute_match(found, truth, radius)
    assert [tuple(p) for p in pairs.tolist()] == expected[0]
    assert gaps == pytest.approx(expected[1])
    assert np.array_equal(
        within_radius(found, truth, radius), (np.linalg.norm(found[:, None] - truth, axis=2) < radius).any(axis=1)
    )


def test_a_duplicate_counts_as_near_but_matches_once():
    found, truth = np.array([[10.0, 10], [11, 10], [50, 50], [14, 10]]), np.array([[10.0, 10.0]])
    assert within_radius(found, truth, 4).tolist() == [True, True, False, False]  # 4 px is not closer than 4 px
    pairs, gaps = match(found, truth, 4)
    assert pairs.tolist() == [[0, 0]]
    assert gaps.tolist() == [0]


def test_empty():
    for found, truth in (([], [[1, 1]]), ([[1, 1]], []), ([], [])):
        pairs, gaps = match(np.array(found), np.array(truth), 2)
        assert pairs.shape == (0, 2)
        assert gaps.shape == (0,)
        assert within_radius(np.array(found), np.array(truth), 2).tolist() == [False] * len(found)
    assert best_f1(np.zeros(0), np.zeros(0, bool), 5) == {"f1": 0, "precision": 0, "recall": 0, "threshold": 0, "ap": 0}


SCORES, HITS = np.array([0.2, 0.9, 0.6, 0.8]), np.array([True, True, True, False])


def test_precision_and_recall_by_hand():
    """By score: hit, miss, hit, hit; five true corners."""
    precision, recall = precision_recall(SCORES, HITS, 5)
    assert precision == pytest.approx([1, 1 / 2, 2 / 3, 3 / 4])
    assert recall == pytest.approx([1 / 5, 1 / 5, 2 / 5, 3 / 5])


def test_best_f1_by_hand():
    """F1 is 2/6, 2/7, 4/8, 6/9; the precision envelope is 1, 3/4, 3/4, 3/4."""
    best = best_f1(SCORES, HITS, 5)
    assert best == {"f1": 0.6667, "precision": 0.75, "recall": 0.6, "threshold": 0.2, "ap": 0.5}
    late = best_f1(np.array([0.9, 0.8, 0.1, 0.1]), np.array([True, True, False, False]), 2)
    assert late == {"f1": 1, "precision": 1, "recall": 1, "threshold": 0.8, "ap": 1}


def test_detections_of_one_score_stand_and_fall_together():
    for hits in ([True, False], [False, True]):
        best = best_f1(np.array([0.5, 0.5]), np.array(hits), 1)
        assert best == {"f1": 0.6667, "precision": 0.5, "recall": 1, "threshold": 0.5, "ap": 0.5}


def test_the_reported_threshold_gives_the_reported_numbers():
    rng = np.random.default_rng(0)
    scores = np.round(rng.random(300), 2)
    hits = rng.random(300) < scores
    best = best_f1(scores, hits, 200)
    kept = hits[scores >= best["threshold"]]
    assert best["precision"] == pytest.approx(kept.mean(), abs=1e-4)
    assert best["recall"] == pytest.approx(kept.sum() / 200, abs=1e-4)
