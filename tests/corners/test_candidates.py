"""From a response map to candidates: what counts, what may only help, and what goes."""

import numpy as np
import pytest

from rcdn.config import Adaptive, DetectorConfig, Fixed, Refine
from rcdn.corners import find_candidates
from rcdn.corners.peaks import nearest_other
from rcdn.types import Status

GREY = ((np.indices((120, 160)) // 20).sum(axis=0) % 2 * 150 + 50).astype(np.uint8)
"""corners at x = 19.5, 39.5, …; y = 19.5, 39.5, …"""


def blobs(spots, shape=(120, 160)):
    """A Gaussian of σ 1 px and the given height at each (x, y, height)."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    out = np.zeros(shape, np.float32)
    for sx, sy, height in spots:
        out = np.maximum(out, height * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 2))
    return out.astype(np.float32)


def config(**changes):
    return DetectorConfig.auto(refine=Refine("peak"), **changes)


def test_sure_seed_and_weak():
    response = blobs([(39.5, 39.5, 0.9), (59.5, 39.5, 0.4), (79.5, 39.5, 0.12), (99.5, 39.5, 0.02)])
    found = find_candidates(GREY, response, config(threshold=Fixed(0.6), seed=0.5, weak=0.1))
    np.testing.assert_allclose(found.all.xy[:, 0], [39.5, 59.5], atol=0.1)
    assert found.sure.tolist() == [True, False]
    assert found.seed.tolist() == [True, True]
    assert len(found.corners) == 1
    fine, status, seen = found.peaks.evaluate(np.arange(len(found.peaks.xy)))  # only where a board asks for it
    np.testing.assert_allclose(fine, [[79.5, 39.5]], atol=0.1)
    assert status.tolist() == [Status.REFINED]
    assert np.isfinite(seen.axes).all()


def test_the_border_holds_no_corner():
    response = blobs([(2, 60, 1.0), (60, 117.5, 1.0), (60, 60, 1.0)])
    found = find_candidates(GREY, response, config(threshold=Fixed(0.5), border=4.0))
    np.testing.assert_allclose(found.all.xy, [[60, 60]], atol=0.1)


@pytest.mark.parametrize("heights", [(0.9, 0.6), (0.6, 0.9)])
def test_of_two_on_one_spot_the_stronger_stays(heights):
    response = np.zeros(GREY.shape, np.float32)
    response[58:63, 60:64] = 0.01
    response[60, 60], response[62, 62] = heights  # two peaks under 3 px apart, which the suppression lets pass
    found = find_candidates(GREY, response, config(threshold=Fixed(0.3)))
    assert len(found.all) == 1
    assert found.all.response[0] == pytest.approx(0.9, abs=0.01)


def test_a_faint_map_is_rescued_and_says_so():
    response = blobs([(39.5, 39.5, 0.4), (59.5, 39.5, 0.3)])
    assert len(find_candidates(GREY, response, config(threshold=Adaptive(), rescue=False)).all) == 0
    found = find_candidates(GREY, response, config(threshold=Adaptive()))
    assert len(found.corners) == 2
    assert (found.corners.status == Status.LOW_CONFIDENCE).all()


def test_a_flat_map_is_not_rescued():
    noise = np.random.default_rng(0).uniform(0, 0.4, GREY.shape).astype(np.float32)
    assert len(find_candidates(GREY, noise, config(threshold=Adaptive())).all) == 0
    assert len(find_candidates(GREY, np.zeros(GREY.shape, np.float32), config(threshold=Adaptive())).all) == 0


def test_pitch_is_the_distance_to_the_nearest_strong_corner_that_is_another_one():
    xy = np.array([[0.0, 0], [20, 0], [21, 0], [20, 30], [90, 90]])
    strong = np.array([True, True, True, True, False])
    np.testing.assert_allclose(nearest_other(xy[strong], xy)[:4], [20, 20, 21, 30.0], atol=0.02)
    assert nearest_other(xy[:1], xy).tolist() == [20.0] * 5


def test_sorted_by_response_then_x_then_y():
    response = blobs([(99.5, 59.5, 0.8), (39.5, 59.5, 0.8), (39.5, 19.5, 0.8), (59.5, 39.5, 0.9)])
    found = find_candidates(GREY, response, config(threshold=Fixed(0.5)))
    np.testing.assert_allclose(found.all.xy, [[59.5, 39.5], [39.5, 19.5], [39.5, 59.5], [99.5, 59.5]], atol=0.1)
