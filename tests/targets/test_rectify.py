"""A grid that is continued beyond what is known of it, against the plain way to say it."""

import numpy as np
import pytest

from rcdn.targets.rectify import _predicted


def predicted(grid):
    """Turned by quarters, each position follows from those above it."""
    total, count = np.zeros(grid.shape), np.zeros(grid.shape[:2])
    for turns in range(4):
        before = np.pad(np.rot90(grid, turns), ((3, 0), (0, 0), (0, 0)), constant_values=np.nan)
        one, two, three = before[2:-1], before[1:-2], before[:-3]
        line = np.rot90(np.where(np.isfinite(three), 3 * one - 3 * two + three, 2 * one - two), -turns)
        known = np.isfinite(line[..., 0])
        total[known] += line[known]
        count += known
    return total / np.where(count, count, np.nan)[..., None]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_the_kernel_predicts_what_the_turned_grids_do(share):
    rng = np.random.default_rng(3)
    for _ in range(50):
        grid = rng.normal(0, 100, (*rng.integers(1, 9, 2), 2))
        grid[rng.random(grid.shape[:2]) < share] = np.nan
        assert np.array_equal(_predicted(grid), predicted(grid), equal_nan=True)


def test_a_smooth_surface_goes_on_as_it_is():
    v, u = np.mgrid[0:8, 0:8].astype(float)
    surface = np.stack([10 * u + 0.3 * u * u + v, 9 * v - 0.2 * v * v], axis=2)
    hidden = surface.copy()
    hidden[3, 4] = hidden[7, 7] = np.nan
    guess = _predicted(hidden)
    assert np.allclose(guess[3, 4], surface[3, 4])
    assert np.allclose(guess[7, 7], surface[7, 7])
