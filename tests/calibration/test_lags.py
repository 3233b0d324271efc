"""Lags of whole moments: found where cameras show one board, never where each shows its own."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration.board_paths import times_of
from rcdn.calibration.coded import Geometries
from rcdn.calibration.known_lens import with_known_lens
from rcdn.calibration.lags import lags_of, late_moments
from rcdn.calibration.rig_graph import sights_of
from rcdn.geometry import rotation
from rcdn_lab.camera_scenes import SPACING, board, see
from rcdn_lab.rig_scenes import row

SCENE = row([0.12], ("pinhole",))
MOMENTS = 40


def seen(camera, path, late=0):
    """The poses of a board that waves along a random path, and their moments."""
    rng, names, boards = np.random.default_rng(path), [], []
    speed, phase, size = rng.uniform(0.1, 0.4, 6), rng.uniform(0, 6.3, 6), rng.uniform(0.3, 1, 6)
    lens, middle = SCENE.cameras[camera], np.linalg.inv(SCENE.places["c1"])
    for m in range(MOMENTS):
        wave, T = size * np.sin(speed * (m + late) + phase), np.eye(4)
        T[:3, :3] = rotation(np.array([0.5, 0.5, 0.2]) * wave[:3])
        T[:3, 3] = np.array([-0.06, -0.08, 0.7]) + np.array([0.1, 0.06, 0.12]) * wave[3:]
        ij, xy = see(lens, SCENE.places[camera] @ middle @ T)
        if len(ij) == 54:
            noise = rng.normal(0, 0.1, xy.shape)
            boards.append(board(ij, xy + noise, lens.image_size, np.full(54, 0.1)))
            names.append(f"frame {m}")
    return with_known_lens(boards, Geometries.of(boards, SPACING), names, lens), names


def lags(*cameras):
    calibrations, when = zip(*cameras, strict=True)
    time = times_of(m for each in when for m in each)
    return lags_of(calibrations, sights_of(calibrations, when), time, [[c] for c in range(len(cameras))])


@pytest.mark.parametrize("late", [-11, 6])
def test_a_camera_that_is_moments_late_is_found_so(late):
    assert lags(seen("c0", 0), seen("c1", 0, late)) in ({0: 0, 1: late}, {0: -late, 1: 0})


@pytest.mark.parametrize("path", range(1, 5))
def test_boards_of_their_own_are_never_brought_together(path):
    assert lags(seen("c0", path), seen("c1", 100 + path)) == {}


def test_a_lag_moves_moments_to_those_of_other_cameras_or_to_new_ones():
    time = {"a1": 1.0, "a2": 2.0, "b3": 3.2}
    when, times = late_moments([["a1", "a2"], ["a2", "b3"]], time, {1: 1})
    assert when == [["a1", "a2"], ["b3", "b3 +1"]]
    assert times == {**time, "b3 +1": 4.2}
