"""Neighbours in the plane, against all distances."""

import numpy as np
import pytest

from rcdn.geometry.near import nearest, pairs, within


def clouds():
    rng = np.random.default_rng(11)
    yield rng.uniform(0, 640, (500, 2))
    yield rng.normal(0, 1, (300, 2)) ** 3 * 100  # crowded in the middle
    yield rng.integers(0, 12, (200, 2)).astype(float)  # many ties
    yield np.column_stack([np.arange(50.0), np.zeros(50)])  # on a line
    yield np.vstack([rng.uniform(0, 100, (60, 2)), [[-1e6, -1e6]] * 5])  # some put away
    yield np.full((7, 2), 3.0)
    yield np.zeros((1, 2))
    yield np.zeros((0, 2))


def distances(points, at):
    return np.hypot(*(at[:, None] - points[None]).transpose(2, 0, 1))


@pytest.mark.parametrize("points", list(clouds()), ids=lambda p: str(len(p)))
@pytest.mark.parametrize("count", [1, 4, 15])
def test_nearest_are_those_of_all_distances(points, count):
    rng = np.random.default_rng(3)
    at = np.vstack([points, rng.uniform(-300, 900, (80, 2))])
    few = rng.permutation(len(at))[:5]  # which are answered another way
    distance, index = nearest(points, at, count)
    assert all((a == b[few]).all() for a, b in zip(nearest(points, at[few], count), (distance, index), strict=True))
    every = np.pad(distances(points, at), ((0, 0), (0, count)), constant_values=np.inf)
    order = np.argsort(every, axis=1, kind="stable")[:, :count]
    np.testing.assert_allclose(distance, np.take_along_axis(every, order, axis=1), rtol=1e-12, atol=1e-12)
    assert (index == np.where(np.isfinite(distance), order, len(points))).all()


@pytest.mark.parametrize("points", list(clouds()), ids=lambda p: str(len(p)))
def test_within_finds_all_and_nothing_else(points):
    rng = np.random.default_rng(4)
    at = np.vstack([points[:40], rng.uniform(-300, 900, (40, 2))])
    reach = rng.uniform(0, 90, len(at))
    row, index = within(points, at, reach)
    first = within(points, at[:4], reach[:4])
    assert [a.tolist() for a in first] == [a[row < 4].tolist() for a in (row, index)]
    expected = np.argwhere(distances(points, at) <= reach[:, None])
    assert (np.column_stack([row, index]) == expected).all()
    assert len(row) == len(expected)


@pytest.mark.parametrize("points", list(clouds()), ids=lambda p: str(len(p)))
def test_pairs_come_once(points):
    found = pairs(points, 5.0)
    i, j = np.nonzero(np.triu(distances(points, points) <= 5.0, 1))
    assert found.tolist() == np.column_stack([i, j]).tolist()


def test_kernels_convert_nothing():
    from rcdn.native import bind

    with pytest.raises(TypeError, match="must be a contiguous float64 array"):
        bind("rcdn_nearest")(np.zeros((2, 2), "f4"), np.zeros((1, 2)), np.zeros((1, 1)), np.zeros((1, 1), "i8"))
