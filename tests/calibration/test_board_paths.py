"""Paths of boards: polynomials of a low degree are followed exactly, at whatever times."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration.board_paths import Path, _jumps
from rcdn.geometry import rotation
from rcdn.geometry.rigid import motion

AXIS = np.array([0.3, -0.2, 0.1])


def place(t):
    """m, a polynomial of the fourth degree."""
    return np.stack([0.1 * t - 0.002 * t**4, 0.05 * t**2, 1 + 0.01 * t**3], axis=-1)


def path(times, reach):
    """A board whose centre is 5 cm off its first corner, and that turns steadily about an axis."""
    middle = np.array([0.05, 0.03, 0.0])
    T = np.array([motion(R := rotation(AXIS * t), place(t) - R @ middle) for t in times])
    frames = np.arange(len(times))
    return Path(frames, times, T, np.tile(middle, (len(times), 1)), np.asarray(reach))


TIMES = np.array([-2.0, -1.0, 0.0, 0.8, 2.0])


def test_five_moments_tell_the_place_and_the_motion_at_the_middle_one():
    boards = path(TIMES, [0, 1, 2, 1, 0])
    assert boards.near.tolist() == [False, True, True, True, False]
    assert boards.velocity[2] == pytest.approx([0.1, 0, 0], abs=1e-12)
    assert np.isnan(boards.velocity[[0, 4]]).all()
    assert boards.motion[2, :3] == pytest.approx(AXIS, abs=1e-12)
    assert boards.motion[2, 3:] == pytest.approx([0.1, 0, 0] - np.cross(AXIS, place(0.0)), abs=1e-12)


def test_later_poses_lie_on_the_path():
    boards = path(TIMES, [0, 1, 2, 1, 0])
    T = boards.later(0.3)[2]
    assert T[:3, :3] == pytest.approx(rotation(AXIS * 0.3), abs=1e-12)
    assert T[:3, :3] @ boards.middle[2] + T[:3, 3] == pytest.approx(place(np.array(0.3)), abs=1e-12)
    assert np.isnan(boards.later(0.3)[4]).all()
    assert np.isnan(boards.later(-0.3)[0]).all()


def test_a_board_that_hardly_moves_does_not_count():
    still = path(np.zeros(5), [0, 1, 2, 1, 0])
    slow = Path(still.frame, TIMES, still.T, still.middle, still.reach)
    assert not slow.moving.any()
    assert not slow.motion.any()


def test_a_board_that_is_taken_elsewhere_begins_another_path():
    along = np.column_stack([0.05 * np.sin(np.arange(12) / 2.2), 0.01 * np.arange(12), np.ones(12)])
    close = np.ones(11, bool)
    assert not _jumps(along, close).any()
    along[6:, 0] += 0.2
    assert np.flatnonzero(_jumps(along, close)).tolist() == [5]
    still = np.tile([0.0, 0.0, 1.0], (12, 1)) + 1e-5 * np.random.default_rng(0).normal(size=(12, 3))
    assert not _jumps(still, close).any()
    alone = np.array([[0.0, 0, 1], [0.1, 0, 1]])
    assert not _jumps(alone, np.ones(1, bool)).any()
