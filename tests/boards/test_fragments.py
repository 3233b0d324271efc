"""Quadrilaterals of corners that stand like those of squares, against all fours one by one."""

from itertools import permutations

import numpy as np
import pytest

from rcdn.boards.fragments import AROUND, OFF, RATIO, SKEW, _quads


def quads(xy):
    """Every corner with every two of its nearest, and the corner nearest to where the fourth would be."""
    gaps = np.linalg.norm(xy[:, None] - xy, axis=2)
    out = set()
    for a in range(len(xy)):
        near = np.lexsort((np.arange(len(xy)), gaps[a]))[1 : AROUND + 1]
        for b, c in permutations(near.tolist(), 2):
            u, v = xy[b] - xy[a], xy[c] - xy[a]
            short, long = sorted((gaps[a, b], gaps[a, c]))
            if u[0] * v[1] - v[0] * u[1] > SKEW * short * long and long < RATIO * short:
                fourth = np.linalg.norm(xy - (xy[b] + xy[c] - xy[a]), axis=1)
                d = int(fourth.argmin())
                if fourth[d] < OFF * short:
                    corners = [a, b, d, c]
                    first = corners.index(min(corners))
                    out.add(tuple(corners[first:] + corners[:first]))
    return np.array(sorted(out)).reshape(-1, 4)


@pytest.mark.parametrize("seed", range(6))
def test_the_kernel_finds_the_quadrilaterals_of_scattered_corners(seed):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 100, (rng.integers(6, 40), 2))
    assert np.array_equal(_quads(xy), quads(xy))


@pytest.mark.parametrize("noise", [0.3, 1.5])
def test_a_grid_has_its_squares(noise):
    rng = np.random.default_rng(7)
    xy = np.stack(np.meshgrid(np.arange(6), np.arange(5)), axis=2).reshape(-1, 2) * 20.0 + rng.normal(0, noise, (30, 2))
    found = _quads(xy)
    assert np.array_equal(found, quads(xy))
    cells = {(k, k + 1, k + 7, k + 6) for k in range(24) if k % 6 < 5}
    assert len(cells & set(map(tuple, found.tolist()))) >= (20 if noise < 1 else 12)
