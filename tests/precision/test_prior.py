"""What a board says of its corners, from boards whose corners were drawn from a known distribution; the median."""

import numpy as np
import pytest

from rcdn.geometry.median import median, medians
from rcdn.precision.model import BLEED, BLUR, CONTRAST, COUNT, CURVE, LIGHT, MEAN, TURN
from rcdn.precision.prior import Prior, board_mean, board_prior, first_prior


def board(cols=14, rows=11, seed=0):
    """Labels, and states of corners in light that rises evenly: contrasts alternate from corner to corner."""
    ij = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)
    state = np.zeros((len(ij), COUNT))
    sign = 1 - 2 * (ij.sum(axis=1) % 2)
    state[:, MEAN] = 120 + ij @ [2.0, -1.0]
    state[:, CONTRAST] = sign * (50 + ij @ [0.5, 0.25])
    rng = np.random.default_rng(seed)
    state[:, BLUR] = np.log(1.3) + rng.normal(0, 0.04, (len(ij), 2))
    state[:, BLEED] = 0.1 + rng.normal(0, 0.04, (len(ij), 1))
    return ij, state, sign


def test_means_are_those_of_the_board():
    ij, state, sign = board()
    mean = board_mean(ij, state)
    assert mean[:, BLUR] == pytest.approx(np.log(1.3), abs=0.01)
    assert mean[:, BLEED] == pytest.approx(0.1, abs=0.01)
    np.testing.assert_allclose(mean[:, LIGHT][:, :2], np.tile([2.0, -1.0], (len(ij), 1)), atol=1e-4)
    np.testing.assert_allclose(mean[:, LIGHT][:, 2:], sign[:, None] * [0.5, 0.25], atol=1e-4)
    assert not mean[:, TURN].any()
    assert not mean[:, CURVE].any()


def test_spreads_are_what_noise_does_not_explain():
    ij, state, _ = board()
    rng, variance = np.random.default_rng(1), np.full(state.shape, 0.01**2)
    state[:, TURN] = rng.normal(0, np.hypot(0.03, 0.01), (len(ij), 2))
    state[:, CURVE] = rng.normal(0, 0.01, (len(ij), 2))  # noise only
    state[30, TURN] = 0.3
    prior = board_prior(ij, state, variance, Prior(state, np.full_like(state, np.inf)))
    others = np.delete(prior.sd, 30, axis=0)
    assert np.median(others[:, TURN]) == pytest.approx(0.03, rel=0.2)
    assert np.median(others[:, CURVE]) < 0.005
    np.testing.assert_allclose(prior.sd[30, TURN], 0.3)  # let go
    assert np.isinf(prior.sd[:, [0, 1, MEAN, CONTRAST]]).all()


def test_few_corners_of_a_kind_keep_what_was_believed():
    ij, state, _ = board(4, 4)
    before = first_prior(state)
    prior = board_prior(ij, state, np.zeros_like(state), before)
    inner = ((ij > 0) & (ij < 3)).all(axis=1)
    known = slice(2, 9)
    np.testing.assert_array_equal(prior.sd[inner, known], before.sd[inner, known])
    assert (prior.sd[~inner, BLUR] < before.sd[~inner, BLUR]).all()


@pytest.mark.parametrize("count", [1, 2, 7, 10])
def test_medians(count):
    values = np.random.default_rng(count).normal(size=(3, count))
    assert np.array_equal(medians(values), np.median(values, axis=1))
    assert median(values.T) == np.median(values)
    values[1, count // 2] = np.nan
    assert np.array_equal(medians(values), np.median(values, axis=1), equal_nan=True)
