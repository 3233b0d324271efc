"""Scores of real rigs, on simulated ones: zero under the truth, known errors under wrong places,
and OpenCV's rig read rightly."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.types import Pose, Rig
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.real_rigs import run
from rcdn_lab.real_rigs.score import scored
from rcdn_lab.real_rigs.sets import SETS, Shots, shots_of
from rcdn_lab.rig_scenes import chain, row

SCENE = row([0.2, 0.2], ("brown",))


def shots(noise=0.0):
    boards, moments = SCENE.views(np.random.default_rng(0), chain(3, 4), noise)
    return Shots({n: dict(zip(moments[n], boards[n], strict=True)) for n in boards})


def truth(scale=1.0):
    first = np.linalg.inv(SCENE.places["c0"])
    poses = []
    for T in SCENE.places.values():
        U = T @ first
        U[:3, 3] *= scale
        poses.append(Pose(U))
    return Rig(tuple(SCENE.cameras), tuple(SCENE.cameras.values()), tuple(poses))


def of_moments(rig, some):
    found = [scored(rig, {n: e[m] for n, e in some.boards.items() if m in e}, SPACING) for m in some.moments]
    return [s for s in found if s is not None]


def test_the_true_rig_has_no_error():
    found = of_moments(truth(), shots())
    assert found
    for key in ("steps", "spans", "rays", "board"):
        assert max(np.abs(getattr(s, key)).max() for s in found) < 1e-5


def test_a_rig_that_is_too_large_has_lengths_that_are():
    figures = run.figures(of_moments(truth(1.02), shots()))
    assert figures["step_permille"] == pytest.approx(20, rel=0.01)
    assert figures["span_permille"] == pytest.approx(20, rel=0.01)
    assert figures["rays_px"] < 1e-3


def test_a_length_that_is_wrong_everywhere_does_not_scatter():
    """A rig 2 % too large: the same lengths are wrong by 2 % at all moments; noise makes them scatter."""
    exact = run.figures(of_moments(truth(1.02), shots()))
    assert max(exact["step_scatter"], exact["span_scatter"]) < 0.01
    noisy = run.figures(of_moments(truth(), shots(0.1)))
    for key in ("step", "span"):
        assert noisy[f"{key}_scatter"] == pytest.approx(noisy[f"{key}_permille"], rel=0.2)


def test_moments_are_dealt_out_once_each():
    some = shots()
    parts = run.folds(some, 3)
    every = [m for part in parts for m in part]
    assert len(every) == len(set(every))
    assert all(sum(m in each for each in some.boards.values()) > 1 for m in every)


def test_opencvs_rig_of_exact_corners_is_the_truth():
    figures = run.held_out(shots(), "opencv", SPACING, 2)
    assert figures["failed"] == 0
    assert figures["step_permille"] < 0.5


def test_the_way_round_three_cameras_closes_within_what_is_stated():
    found = run.closing(shots(0.1), SPACING)
    assert found["chi2"] < 4


def test_the_trinocular_photographs_are_read(shared_data):
    of = SETS[0]
    folder = of.inside([shared_data])
    if folder is None:
        pytest.skip("the set isn't in the shared data")
    found = shots_of(of, folder)
    assert list(found.boards) == ["left", "middle", "right"]
    assert min(len(each) for each in found.boards.values()) >= 6
