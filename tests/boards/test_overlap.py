"""Boards over each other that were linked into one lattice become two; bent, folded and widely seen ones stay one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards.local import Grid
from rcdn.boards.overlap import separated
from rcdn.boards.validate import skips_lines

SIZE = (640, 480)


def labels(cols, rows, at=(0, 0)):
    return np.array([(u + at[0], v + at[1]) for v in range(rows) for u in range(cols)])


def placed(spots, pitch, turn, at, tilt=0.0):
    """Positions of corners on a plane, turned and tilted about `at`."""
    c, s = np.cos(turn), np.sin(turn)
    xy = (spots - spots.mean(axis=0)) * pitch @ [[c, s], [-s, c]]
    return xy / (1 + tilt * xy[:, :1] / 500) + at


def grid_of(spots, xy, seed=0, noise=0.05):
    rng = np.random.default_rng(seed)
    return Grid({tuple(spot): k for k, spot in enumerate(spots.tolist())}, xy + rng.normal(0, noise, xy.shape))


def overlapping(turn, tilt, seed=0):
    """A board of 7 × 6 corners before one of 8 × 5, joined at the last corner of one row."""
    near, far = labels(7, 6), labels(8, 5, at=(7, 4))
    first, second = placed(near, 22.0, 0.1, (200, 200), tilt), placed(far, 24.0, 0.1 + turn, (0, 0), -tilt)
    joint = first[(near == (6, 4)).all(axis=1)][0] + (22.0, 2.0)
    second += joint - second[(far == (7, 4)).all(axis=1)][0]
    return grid_of(np.concatenate([near, far]), np.concatenate([first, second]), seed), len(near)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(0.25, 0.7), st.floats(-0.4, 0.4), st.integers(0, 99))
def test_two_boards_joined_at_a_neck_become_two(turn, tilt, seed):
    grid, many = overlapping(turn, tilt, seed)
    found = separated(grid, SIZE)
    assert len(found) == 2
    assert {frozenset(part.at.values()) for part in found} == {
        frozenset(range(many)),
        frozenset(range(many, len(grid))),
    }
    assert all(part.at[spot] == grid.at[spot] for part in found for spot in part.at)


def bent(spots):
    """On a cylinder."""
    angle = (spots[:, 0] - 4) * 0.2
    return np.column_stack([150 * np.sin(angle), 30 * spots[:, 1] + 40 * (1 - np.cos(angle))]) + np.array([300, 150])


def folded(spots):
    """Along a line of corners."""
    over = np.maximum(spots[:, 0] - 4, 0)
    return np.column_stack([30 * np.minimum(spots[:, 0], 4) + 18 * over, 30 * spots[:, 1] + 12 * over]) + np.array(
        [150, 100]
    )


def fisheye(spots):
    xy = (spots - (6, 1)) * 40.0
    radius = np.linalg.norm(xy, axis=1, keepdims=True) / 250
    return xy / (1 + 0.8 * radius**2) + (319.5, 239.5)


@pytest.mark.parametrize("shape", [bent, folded, fisheye, lambda spots: placed(spots, 30.0, 0.3, (320, 240), 0.6)])
@pytest.mark.parametrize("missing", [1, 12])
def test_one_board_stays_one(shape, missing):
    spots = labels(9, 6)
    left = np.random.default_rng(missing).permutation(len(spots))[missing:]
    grid = grid_of(spots[left], shape(spots[left].astype(float)))
    assert separated(grid, SIZE) == [grid]


def test_few_corners_and_whole_boards_are_left_alone():
    for spots in (labels(9, 6), labels(4, 4)[:-1]):
        grid = grid_of(spots, folded(spots.astype(float)))
        assert separated(grid, SIZE) == [grid]


class Candidates:
    """What `skips_lines` needs to know of a field: positions, and which of them are strong corners."""

    def __init__(self, xy):
        self.xy, self.strong = xy, np.ones(len(xy), bool)

    def near(self, some, spots, margin):
        inside = (self.xy >= spots.min(axis=0) - margin) & (self.xy <= spots.max(axis=0) + margin)
        return np.flatnonzero(some & inside.all(axis=1))


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_lattice_of_every_other_line_skips_lines(noise):
    """Its cells are sheared, so that the corners of the lines between lie in the middle of sides or cells."""
    spots = labels(9, 7)
    xy = spots * 20.0 + np.random.default_rng(1).normal(0, noise, spots.shape)
    field, every = Candidates(xy), {tuple(spot): k for k, spot in enumerate(spots.tolist())}
    sheared = {(u, v // 2): k for (u0, v), k in every.items() if v % 2 == 0 and 0 <= (u := u0 - v // 2) < 6}
    assert skips_lines(Grid(sheared, xy), field)
    assert not skips_lines(Grid(every, xy), field)


def test_markers_in_squares_of_one_colour_are_no_skipped_lines():
    spots = labels(9, 7)
    markers = np.array([(u + 0.5, v + 0.5) for u in range(8) for v in range(6) if (u + v) % 2])
    field = Candidates(20.0 * np.concatenate([spots, markers]))
    assert not skips_lines(Grid({tuple(spot): k for k, spot in enumerate(spots.tolist())}, field.xy), field)
