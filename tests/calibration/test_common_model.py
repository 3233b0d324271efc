"""Lenses of one make get one model; others keep their own; few pictures lean on the twin's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_stereo import T_RIGHT_LEFT, pairs

from rcdn.calibration import calibrate, calibrate_stereo, common_model
from rcdn.calibration.common_model import alike, one_model
from rcdn.errors import CalibrationError
from rcdn.types import Camera, ModelScore
from rcdn_lab.camera_scenes import CAMERAS, SPACING

BROWN, FISHEYE, PINHOLE = (CAMERAS[m] for m in ("brown", "fisheye", "pinhole"))


def lens(camera, share):
    """The same lens, a share longer."""
    return Camera(
        camera.K * [[1 + share, 1, 1], [1, 1 + share, 1], [1, 1, 1]], camera.distortion, camera.image_size, camera.model
    )


def found_as(calibration, model):
    """As if `auto` had taken `model`."""
    return replace(calibration, models=(ModelScore(model, 0.2, 0.2), ModelScore("rational", 0.2, np.nan)))


@pytest.fixture(scope="module")
def twins():
    """Boards of two Brown lenses, 1 % apart, and their calibrations under each model that is asked for."""
    boards = pairs(BROWN, lens(BROWN, 0.01), 5, 8, spread=0.45)
    done = {}

    def under(side, model):
        if (side, model) not in done:
            done[side, model] = calibrate(boards[side], SPACING, model=model)
        return done[side, model]

    return boards, under


@pytest.mark.parametrize("alone", [("fisheye", "brown"), ("brown", "pinhole")])
def test_twins_get_the_model_that_predicts_both(twins, alone):
    _, under = twins
    both = tuple(under(side, model) for side, model in enumerate(alone))
    left, right, note = one_model(both, under, [(k, k) for k in range(8)])
    assert left.camera.model == right.camera.model == left.models[0].model == right.models[0].model == "brown"
    other = next(side for side, model in enumerate(alone) if model != "brown")
    assert f"{alone[other]} on the {('left', 'right')[other]}" in note
    assert (left, right)[1 - other].camera is both[1 - other].camera


def test_cameras_that_agree_are_left_as_they_are(twins):
    _, under = twins
    both = under(0, "brown"), under(1, "brown")
    assert one_model(both, under, []) == (*both, "")


def test_scores_of_the_models_that_were_tried_are_kept(twins):
    _, under = twins
    wrong = found_as(under(1, "fisheye"), "fisheye")
    right = one_model((under(0, "brown"), wrong), under, [(k, k) for k in range(8)])[1]
    assert [m.model for m in right.models] == ["brown", "fisheye", "rational"]
    assert np.isfinite(right.models[0].held_out)


def test_a_camera_of_few_pictures_takes_the_model_of_its_twin(twins):
    boards, under = twins
    few = calibrate(boards[1][:5], SPACING, model="pinhole")

    def again(side, model):
        return under(0, model) if side == 0 else calibrate(boards[1][:5], SPACING, model=model)

    left, right, note = one_model((under(0, "brown"), few), again, [(k, k) for k in range(5)])
    assert left.camera is under(0, "brown").camera
    assert right.camera.model == "brown"
    assert note


def test_a_model_that_a_camera_cannot_have_is_none_for_both(twins):
    _, under = twins

    def fails(side, model):
        raise CalibrationError("no")

    both = under(0, "brown"), under(1, "fisheye")
    left, right, note = one_model(both, fails, [])
    assert (left, right) == both
    assert "no one model does for both: brown on the left, fisheye on the right" in note


def test_a_poor_model_is_not_common_because_the_good_one_folds(twins, monkeypatch):
    """`pinhole` has rays everywhere and predicts neither camera; that `brown` has none in a part of the frame doesn't
    make it fair."""
    _, under = twins
    both = under(0, "brown"), under(1, "pinhole")
    monkeypatch.setattr(common_model, "reach", lambda camera: 0.8 if camera.model == "brown" else 1.0)
    left, right, note = one_model(both, under, [(k, k) for k in range(8)])
    assert (left, right) == both
    assert "no one model does for both" in note


def test_other_lenses_are_not_alike(twins):
    _, under = twins
    one = under(0, "brown")
    assert alike(one, under(1, "brown"))
    assert alike(one, under(1, "fisheye"))
    assert not alike(one, replace(one, camera=lens(one.camera, 0.1)))
    assert not alike(
        one,
        replace(one, camera=replace(one.camera, image_size=(one.camera.image_size[0] * 2, one.camera.image_size[1]))),
    )


def test_a_fisheye_beside_a_normal_lens_keeps_its_own_model():
    left, right = pairs(PINHOLE, FISHEYE, 2, 8, spread=0.45)
    found = calibrate_stereo(left, right, SPACING)
    assert (found.left.camera.model, found.right.camera.model) == ("pinhole", "fisheye")
    assert not any("alike" in line for line in found.advice)
    assert found.T_right_left == pytest.approx(T_RIGHT_LEFT, abs=0.02)
