"""Threshold rules against their formulas and on maps without corners."""

import math

import numpy as np
import pytest

from rcdn.config import Adaptive, Fixed, MaxFraction, Std
from rcdn.corners.threshold import threshold_value

RESPONSE = np.array([[0.0, 0.5, 0.6], [1.0, 0.2, 1.4]], np.float32)


@pytest.mark.parametrize(
    ("rule", "value"),
    [
        (Fixed(0.3), 0.3),
        (Adaptive(), 1.0),  # 0.5 itself doesn't count
        (Adaptive(0.9), 1.2),
        (MaxFraction(0.41), 0.41 * 1.4),
        (Std(0.8), 3.7 / 6 + 0.8 * np.std([0, 0.5, 0.6, 1, 0.2, 1.4])),
    ],
)
def test_formulas(rule, value):
    assert threshold_value(RESPONSE, rule) == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("rule", [Adaptive(), Std(), MaxFraction()])
def test_map_without_response_has_no_corner(rule):
    assert threshold_value(np.zeros((4, 5), np.float32), rule) == math.inf
    assert threshold_value(np.zeros((0, 5), np.float32), rule) == math.inf


def test_adaptive_scales_itself_but_std_follows_the_area():
    peaks = np.zeros((50, 50), np.float32)
    peaks[10:40:10, 10:40:10] = 10
    wide = np.pad(peaks, 100)
    assert threshold_value(peaks, Adaptive()) == threshold_value(wide, Adaptive()) == 10
    assert threshold_value(wide, Std()) < 0.3 * threshold_value(peaks, Std())


def test_adaptive_is_a_double_precision_mean():
    response = np.full((2000, 2000), 0.7, np.float32)
    assert threshold_value(response, Adaptive()) == pytest.approx(float(np.float32(0.7)), abs=1e-12)
