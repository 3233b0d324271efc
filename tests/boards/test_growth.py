"""Geiger's growth on point lattices with known answers."""

import numpy as np
import pytest

from rcdn.boards.geiger import CONE, NEAREST, Pool, energy, grow_lines


def lattice(cols, rows, step=10.0):
    """Positions (rows, cols, 2)."""
    return np.stack(np.meshgrid(np.arange(cols) * step, np.arange(rows) * step), axis=-1)


def pool_of(xy, turn=0.0):
    """A pool of points whose edge directions all are `turn` and a right angle to it."""
    return Pool(np.asarray(xy, float), np.tile([turn % np.pi, (turn + np.pi / 2) % np.pi], (len(xy), 1)))


def test_energy_by_hand():
    flat = lattice(4, 3)
    assert energy(flat) == -12
    bent = flat.copy()
    bent[1, 1] += [1, 0]  # its row: x = 0, 11, 20, 30: |0 + 20 − 22| / 20 and |11 + 30 − 40| / 19; its column: 2 / 20
    assert energy(bent) == pytest.approx(-12 * (1 - 0.1))
    assert energy(flat[:2, :2]) == -4
    assert energy(np.zeros((3, 3, 2))) == -9  # three on one spot: no division by zero


def test_energy_knows_columns_and_rows_alike():
    bent = lattice(5, 4) + np.random.default_rng(0).normal(0, 1, (4, 5, 2))
    assert energy(bent) == pytest.approx(energy(bent.swapaxes(0, 1)))
    assert energy(bent) == pytest.approx(energy(bent[::-1, ::-1]))
    assert energy(bent) == pytest.approx(energy(3 * bent + 7))


def test_the_neighbour_of_least_cost_within_the_cone():
    """Costs: straight on at 12: 12; nearer but aside, (8, 2): 8 + 5·2 = 18; (9, 0.5): 11.5; beyond 25° at 1: none."""
    xy = np.array([[0, 0], [12, 0], [8, 2], [9, 0.5], [1, 0.6], [-3, 0]])
    pool = pool_of(xy)
    order = []
    while (found := pool.neighbour(0, 0.0)) is not None:
        order.append(found)
        pool.free[found] = False
    assert order == [3, 1, 2]
    assert pool.neighbour(0, np.pi) == 5
    assert np.arctan2(0.6, 1) > CONE


def test_own_directions_lead_where_they_are_near():
    """Corner 0's own edge runs 10° off what is asked for, and on to corner 1; corner 2 lies where it was asked for."""
    a = np.radians(10)
    xy = np.array([[0, 0], [20 * np.cos(a), 20 * np.sin(a)], [20, 0]])
    assert pool_of(xy, turn=a).toward(0, 0.0) == 1
    assert pool_of(xy, turn=np.radians(40)).toward(0, 0.0) == 2
    pool = Pool(xy, np.full((3, 2), np.nan))
    assert pool.toward(0, 0.0) == 2


@pytest.mark.parametrize(("count", "seen"), [(NEAREST - 1, 1), (NEAREST, None)])
def test_only_the_nearest_corners_are_looked_at(count, seen):
    """This bounds the time: corner 1 lies straight ahead, with `count` others on the far side that are nearer."""
    angle = np.linspace(np.pi / 2 + 0.1, 3 * np.pi / 2 - 0.1, count)
    behind = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 5
    assert pool_of(np.concatenate([[[0, 0], [20, 0]], behind])).neighbour(0, 0.0) == seen


@pytest.mark.parametrize(("cols", "rows"), [(3, 3), (7, 5), (12, 3)])
@pytest.mark.parametrize("start", [(0, 0), (1, 1)])
def test_a_perfect_lattice_is_taken_whole(cols, rows, start):
    i, j = min(start[0], cols - 3), min(start[1], rows - 3)
    index = np.arange(cols * rows).reshape(rows, cols)
    grown = grow_lines(pool_of(lattice(cols, rows).reshape(-1, 2)), index[j : j + 3, i : i + 3])
    assert np.array_equal(grown, index)


def test_growth_stops_where_a_line_lacks_a_corner():
    index = np.arange(24).reshape(4, 6)
    pool = pool_of(lattice(6, 4).reshape(-1, 2))
    pool.free[5] = False  # of the last column three corners are left
    assert np.array_equal(grow_lines(pool, index[:3, :3]), index[:, :5])


@pytest.mark.parametrize(("shift", "cols"), [(4, 4), (6, 3)])
def test_growth_stops_where_the_energy_would_rise(shift, cols):
    """Behind the third column the lattice breaks off sideways by `shift`: bend = shift / |(20, shift)|,
    and 12 (1 − bend) > 9 up to 0.25."""
    xy = lattice(4, 3)
    xy[:, 3] += [0, shift]
    index = np.arange(12).reshape(3, 4)
    assert grow_lines(pool_of(xy.reshape(-1, 2)), index[:, :3]).shape == (3, cols)


def test_steps_that_shrink_are_followed():
    """Columns at distances 20, 16, 12.8, …, as under strong distortion: |x₁ + x₃ − 2x₂| / |x₁ − x₃| = 1/9."""
    x = np.concatenate([[0], np.cumsum(20 * 0.8 ** np.arange(7))])
    xy = np.stack(np.meshgrid(x, np.arange(4) * 15.0), axis=-1)
    index = np.arange(xy.shape[0] * xy.shape[1]).reshape(xy.shape[:2])
    assert np.array_equal(grow_lines(pool_of(xy.reshape(-1, 2)), index[:3, :3]), index)


def test_taken_corners_are_left_alone():
    pool = pool_of(lattice(5, 3).reshape(-1, 2))
    pool.free[4] = False
    index = np.arange(15).reshape(3, 5)
    assert np.array_equal(grow_lines(pool, index[:, :3]), index[:, :4])
