"""Which lens model is taken, and what pictures held out say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate, choose
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.difference import difference
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards


def whole_boards(model, seed, views, **more):
    """(true state, what models are compared on) of whole boards."""
    boards, poses = random_boards(CAMERAS[model], seed, views, whole=True, **more)
    n = len(boards[0])
    frame = np.repeat(np.arange(views), n)
    ij, xy = np.concatenate([b.ij for b in boards]), np.concatenate([b.xy for b in boards])
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 2)))
    return State.mono(CAMERAS[model], np.array(poses)), choose.Task(corners, np.full(len(frame), 5.0), frame)


def lensed(state, model):
    """The same poses under another lens model, without any bend yet."""
    lens = {"pinhole": 0, "brown": 5, "fisheye": 4, "rational": 8}[model]
    return replace(state, cameras=(Camera(state.cameras[0].K, np.zeros(lens), (640, 480), model),))


def test_rms_is_of_lengths_by_their_weights_squared():
    gaps = np.array([[3.0, 4.0], [0, 0], [100, 100]])
    assert choose.rms(gaps, np.array([1.0, 1, 0])) == pytest.approx(np.sqrt(12.5))
    assert choose.rms(gaps, np.array([1.0, 2, 0])) == pytest.approx(np.sqrt(5))
    assert np.isnan(choose.rms(gaps, np.zeros(3)))
    assert np.isnan(choose.rms(gaps * np.nan, np.ones(3)))
    gaps[1] = np.nan
    assert choose.rms(gaps, np.ones(3)) == np.inf


@pytest.mark.parametrize("model", ["pinhole", "brown"])
def test_the_simplest_that_does_nearly_as_well(model):
    state, task = whole_boards(model, 0, 8)
    starts = {m: lensed(state, m) for m in ("pinhole", "brown", "rational")}
    at, scores = choose.compare(starts, task, [default_free(s) for s in starts.values()])
    assert scores[at].model == model
    assert scores[0].rms >= scores[1].rms >= scores[2].rms - 1e-4  # each can do all that the one before it can
    assert scores[at].held_out <= choose.SIMPLER * np.nanmin([s.held_out for s in scores])


def test_blurred_pictures_do_not_hide_a_lens():
    """Two pictures of 20 px deviation swamp the errors that `pinhole` leaves on a bent lens, unless weighted."""
    state, task = whole_boards("brown", 0, 10)
    blurred = task.picture >= 8
    task.corners.xy[blurred] += np.random.default_rng(1).normal(0, 20, (blurred.sum(), 2))
    task.weight[blurred] = 0.05
    starts = {m: lensed(state, m) for m in ("pinhole", "brown")}
    at, scores = choose.compare(starts, task, [default_free(s) for s in starts.values()])
    assert scores[at].model == "brown"


def test_held_out_is_a_calibration_of_the_others():
    """Corners of a picture are held out together; their error is a little above that of the fit."""
    start, task = whole_boards("brown", 0, 10)
    task.weight[5] = 0
    free = default_free(start)
    held = choose.held_out(start, task, free)
    assert np.isnan(held[5]).all()
    assert np.isfinite(np.delete(held, 5, axis=0)).all()
    _, (score,) = choose.compare({"brown": start}, task, [free])
    assert score.rms < score.held_out < 1.2 * score.rms
    assert score.held_out == pytest.approx(choose.rms(held, task.weight), rel=1e-3)
    few = replace(task, picture=task.picture % 3)
    assert np.isnan(choose.held_out(start, few, free)).all()


def test_a_model_that_fits_too_much_is_worse_held_out():
    """Few small boards: an eight-number lens follows their noise."""
    state, task = whole_boards("pinhole", 3, 5, noise=0.5, size=(4, 3))
    fits, helds = [], []
    for model in ("pinhole", "rational"):
        start = lensed(state, model)
        _, (score,) = choose.compare({model: start}, task, [default_free(start)])
        fits.append(score.rms)
        helds.append(score.held_out)
    assert fits[1] < fits[0]
    assert helds[1] > helds[0]


@pytest.mark.parametrize(("model", "outliers"), [("pinhole", 0.0), ("brown", 0.05)])
def test_auto_takes_the_family_of_the_lens(model, outliers):
    boards, _ = random_boards(CAMERAS[model], 1, 10, outliers=outliers)
    found = calibrate(boards, SPACING)
    assert found.camera.model == model
    assert found.models[0].model == model
    assert found.held_out == found.models[0].held_out
    assert found.held_out <= choose.SIMPLER * np.nanmin([m.held_out for m in found.models])


def test_auto_compares_a_model_whose_noise_does_not_vanish():
    """Outliers make one model's noise vanish before another's: that alone mustn't rule a model out."""
    found = calibrate(random_boards(CAMERAS["pinhole"], 1, 12, 0.2, 0.05)[0], SPACING)
    assert found.camera.model == "pinhole"


def test_a_lens_without_rays_at_the_rim_is_better_than_one_of_another_kind():
    """In the middle of a fisheye's frame every bent lens fits, and may fold beyond; `pinhole` has rays everywhere, and
    twice the error."""
    boards, _ = random_boards(CAMERAS["fisheye"], 1, 20, 0.3, whole=True)
    found = calibrate(boards, SPACING)
    errors = {m.model: m.rms for m in found.models}
    assert found.rms < 0.6 * errors["pinhole"]
    seen = np.concatenate([b.xy for b in boards])
    assert difference(found.camera, CAMERAS["fisheye"], seen)[0].max() < 2
    assert "no rays" in found.verdict.against[0].sentence


def test_with_three_pictures_nothing_is_held_out_and_a_bent_lens_is_brown():
    boards, _ = random_boards(CAMERAS["brown"], 3, 12)
    found = calibrate(boards, SPACING, names=["a", "b", "c"] * 4)
    assert np.isnan(found.held_out)
    assert found.camera.model == "brown"
