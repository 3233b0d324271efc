"""Rows of arrays of points."""

import numpy as np
import pytest

from rcdn.geometry.rows import joint, rows_among


def test_parts_become_one_array():
    assert np.array_equal(joint([np.ones((2, 2)), np.zeros((1, 2))], (0, 2)), [[1, 1], [1, 1], [0, 0]])
    assert joint([], (0, 2)).shape == (0, 2)


@pytest.mark.parametrize("seed", range(3))
def test_points_are_found_by_the_very_same_numbers(seed):
    rng = np.random.default_rng(seed)
    among = rng.integers(0, 6, (40, 2)) / 3
    xy = np.concatenate([among[::3], among[:5] + 1e-12, rng.uniform(0, 2, (7, 2)), [[-0.0, 0.0]]])
    expected = [next((k for k, b in enumerate(among) if (a == b).all()), -1) for a in xy]
    assert rows_among(xy, among).tolist() == expected
    assert rows_among(xy, np.zeros((0, 2))).tolist() == [-1] * len(xy)
    assert rows_among(np.zeros((0, 2)), among).shape == (0,)
