"""The validation score on response maps made by hand."""

import numpy as np
import pytest

pytest.importorskip("torch")
from rcdn.validation import score_crop


def scored(peaks, corners, size=64):
    """Scores, hits, distances and corner count; `peaks` (x, y, height), `corners` (x, y, kind)."""
    response = np.zeros((size, size), np.float32)
    for x, y, height in peaks:
        response[y, x] = height
    score, hit, gap, total = score_crop(response, np.array(corners, float).reshape(-1, 3))
    order = np.argsort(-score, kind="stable")
    return np.round(score[order].astype(float), 3).tolist(), hit[order].tolist(), np.round(gap, 3).tolist(), total


def test_hit_miss_and_false_alarm():
    peaks = [(20, 20, 0.9), (40, 40, 0.6), (30, 50, 0.04)]
    assert scored(peaks, [(20.6, 20.8, 1), (50, 20, 1), (30, 50, 1)]) == ([0.9, 0.6], [True, False], [1.0], 3)


def test_two_pixels_are_too_far():
    assert scored([(20, 20, 0.9)], [(22, 20, 1)]) == ([0.9], [False], [], 1)
    assert scored([(20, 20, 0.9)], [(21.9, 20, 1)]) == ([0.9], [True], [1.9], 1)


def test_a_second_peak_at_a_corner_is_a_false_alarm():
    assert scored([(20, 20, 0.5), (20, 24, 0.9)], [(20, 21.5, 1)]) == ([0.9, 0.5], [False, True], [1.5], 1)


@pytest.mark.parametrize("peaks", [[], [(20, 20, 0.9)], [(23, 20, 0.9)]])
def test_a_doubtful_corner_is_neither_demanded_nor_forbidden(peaks):
    assert scored(peaks, [(20, 20, 0)]) == ([], [], [], 0)


def test_doubt_ends_after_four_pixels():
    assert scored([(24, 20, 0.9)], [(20, 20, 0)]) == ([0.9], [False], [], 0)


def test_a_sure_corner_beside_a_doubtful_one_counts():
    assert scored([(20, 20, 0.9)], [(20, 20, 1), (22, 20, 0)]) == ([0.9], [True], [0.0], 1)


def test_the_rim_does_not_count():
    """x < 8 and x > 55: a peak there may still hit a corner inside, and a peak inside a corner there."""
    assert scored([(7, 20, 0.9), (56, 30, 0.8)], [(7, 20, 1)]) == ([], [], [], 0)
    assert scored([(7, 20, 0.9)], [(8.2, 20, 1)]) == ([0.9], [True], [1.2], 1)
    assert scored([(8, 20, 0.9)], [(7.9, 20, 1)]) == ([], [], [], 0)
    assert scored([(8, 8, 0.9), (55, 55, 0.8)], [(8, 8, 1)]) == ([0.9, 0.8], [True, False], [0.0], 1)
