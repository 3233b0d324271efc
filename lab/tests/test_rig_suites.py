"""Simulated rigs and videos put out of step: errors are zero under the truth, shifts are those that were asked for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rcdn.types import Pose, Rig
from rcdn_lab.real_rigs.sets import Shots
from rcdn_lab.rig_scenes import chain, row
from rcdn_lab.rig_shifts import FIRST, shifted
from rcdn_lab.rigs import errors, trials

SCENE = row([0.2, 0.3])


def solved(off=0.0):
    """The true rig with deviations of 1 mm and 1 mrad, its last camera `off` m to the side."""
    first = np.linalg.inv(SCENE.places["c0"])
    places = [T @ first for T in SCENE.places.values()]
    places[2][0, 3] += off
    rig = Rig(tuple(SCENE.cameras), tuple(SCENE.cameras.values()), tuple(map(Pose, places)), 1e-6 * np.eye(18))
    return SimpleNamespace(rig=rig)


def test_errors_are_of_each_two_cameras_in_their_deviations():
    assert errors(solved(), SCENE) == pytest.approx(np.zeros((3, 6)), abs=1e-6)
    off = errors(solved(0.002), SCENE)
    assert np.abs(off[0]).max() < 1e-6  # the first two cameras
    assert np.abs(off[1:]).max() > 1


def test_a_shifted_camera_is_later_by_so_many_frames():
    boards, moments = SCENE.views(np.random.default_rng(0), chain(3, 2))
    shots = Shots({n: dict(zip(moments[n], boards[n], strict=True)) for n in boards})
    late = shifted(shots, "c1", 2)
    for name, by in (("c0", 0), ("c1", 2), ("c2", 0)):
        for m, board in shots.boards[name].items():
            assert late.boards[name][str(FIRST + int(m) - by)] is board


def test_the_rigs_that_are_asked_for_are_among_the_trials():
    every = trials()
    counts = {name: len(t.scene.cameras) for name, t in every.items()}
    assert counts["ring of 4, 10 % overlap"] == 4
    assert counts["two clusters of 4"] == 8
    assert counts["16 around a room"] == 16
    assert every["one camera in 3 pictures"].most == {"c2": 3}
    assert {c.model for c in every["fisheye and pinhole"].scene.cameras.values()} == {"fisheye", "pinhole"}
    (large,) = trials(large=True).values()
    assert len(large.between) >= 500
