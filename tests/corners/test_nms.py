"""Suppression against a naive greedy over all pairs, and its bounds."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.config import Nms
from rcdn.corners.nms import candidates, nms, stencil


def naive(response, threshold, rule):
    """Plain greedy: every candidate against every stronger survivor."""
    pixels = [(-response[y, x], y, x) for y, x in np.ndindex(response.shape) if response[y, x] >= threshold]
    keep = []
    for _, y, x in sorted(pixels):
        overlaps = [max(0, rule.box - abs(x - u)) * max(0, rule.box - abs(y - v)) for u, v in keep]
        if all(area / rule.box**2 <= rule.overlap for area in overlaps):
            keep.append((x, y))
    return keep


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    shape=st.tuples(st.integers(1, 18), st.integers(1, 18)),
    box=st.sampled_from([1, 3, 5, 9]),
    overlap=st.sampled_from([0.01, 0.2, 0.5, 0.9]),
    levels=st.sampled_from([2, 5, 1000]),
    seed=st.integers(0, 10**6),
)
def test_equals_naive_greedy(shape, box, overlap, levels, seed):
    """Few levels make plateaus and ties."""
    response = (np.random.default_rng(seed).integers(0, levels, shape) / levels).astype(np.float32)
    rule = Nms(box, overlap)
    xy, score = nms(response, 0.3, rule)
    assert [tuple(p) for p in xy.tolist()] == naive(response, 0.3, rule)
    assert (np.diff(score) <= 0).all()
    assert np.array_equal(score, response[xy[:, 1], xy[:, 0]])


def test_paper_boxes_suppress_four_on_axis_two_on_diagonal():
    mask = stencil(Nms(9, 0.5))
    assert mask.shape == (9, 9)
    assert mask[4].all()
    assert [bool(mask[4 + k, 4 + k]) for k in range(5)] == [True, True, True, False, False]


def test_an_overlap_equal_to_the_limit_stays():
    assert stencil(Nms(5, 0.2)).shape == (7, 7)  # four columns away, 5 of 25 pixels are shared


def test_candidates_are_at_or_above_the_threshold():
    response = np.array([[0.2, 0.5], [np.nan, 0.9]], np.float32)
    assert candidates(response, 0.5).tolist() == [[1, 0], [1, 1]]
    assert candidates(response, np.inf).shape == (0, 2)
    xy, score = nms(response, np.inf, Nms())
    assert xy.shape == (0, 2)
    assert score.shape == (0,)


def test_ties_go_by_row_then_column():
    response = np.zeros((12, 12), np.float32)
    response[8, 1] = response[2, 9] = response[2, 3] = 1
    assert nms(response, 0.5, Nms(3))[0].tolist() == [[3, 2], [9, 2], [1, 8]]


def test_limit_keeps_the_strongest_and_first():
    response = np.array([[3, 1, 2, 2, 2, 5]], np.float32)
    xy, _ = nms(response, 0.5, Nms(1), limit=4)
    assert xy[:, 0].tolist() == [5, 0, 2, 3]


@pytest.mark.parametrize("kind", ["flat", "noise", "ramp"])
def test_time_is_bounded_on_a_map_full_of_candidates(kind):
    size = (1080, 1920)
    ramp = np.linspace(0.5, 1, size[0] * size[1], dtype=np.float32).reshape(size)
    noise = np.random.default_rng(0).uniform(0.5, 1, size).astype(np.float32)
    response = {"flat": np.ones(size, np.float32), "noise": noise, "ramp": ramp}[kind]
    start = time.process_time()
    xy, _ = nms(response, 0.3, Nms(5))
    assert time.process_time() - start < 2
    assert 0 < len(xy) <= 20000


def test_peaks_only_keeps_the_flank_of_a_wide_peak_out():
    y, x = np.mgrid[:40, :40]
    wide = np.exp(-((x - 20) ** 2 + (y - 20) ** 2) / 60).astype(np.float32)
    assert len(nms(wide, 0.3, Nms(5))[0]) > 4
    xy, score = nms(wide, 0.3, Nms(5, peaks=True))
    assert xy.tolist() == [[20, 20]]
    assert score.tolist() == [1.0]
