"""What is said to the person with the camera: each sentence where it belongs, none where all is well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.advice import THIRDS, advise, tilts
from rcdn.evaluation.camera_scenes import CAMERAS, SPACING, random_boards
from rcdn.types import ModelScore

BROWN = CAMERAS["brown"]


@pytest.fixture(scope="module")
def good():
    return calibrate(random_boards(BROWN, 3, 40)[0], SPACING, model="brown")


def test_nothing_to_say_of_a_good_calibration(good):
    assert advise(good) == good.advice == ()


def says(calibration, text):
    return any(text in sentence for sentence in advise(calibration))


def test_each_weakness_has_its_sentence(good):
    few = replace(good, views=good.views[:6])
    assert says(few, "Only 6 views")
    loose = good.cov.copy()
    loose[0, 0] = (0.02 * good.camera.K[0, 0]) ** 2
    assert says(replace(good, cov=loose), "focal length is known only to ±2.0%")
    assert says(replace(good, models=(ModelScore("brown", 0.3, 3 * good.rms),)), "fit 3.0 times worse")
    assert not says(replace(good, models=(ModelScore("brown", 0.3, np.nan),)), "times worse")
    assert says(replace(good, spacing=25.0), "25 m")
    assert says(replace(good, size=(8, 6), orientation="ambiguous_180"), "half a turn")
    assert says(replace(good, size=(6, 6), orientation="ambiguous_90"), "quarter turns")
    assert says(replace(good, size=None, orientation=None), "name its size")
    rough = tuple(replace(v, residuals=v.residuals * 10) for v in good.views)
    assert says(replace(good, views=rough), "is the board flat")


def test_a_lens_that_turns_back_inside_the_picture_is_said_first(good):
    """x·(1 − 0.9·r²) turns back at r = 0.61; the picture's corners lie at 0.77."""
    parameters = good.camera.parameters.copy()
    parameters[4:] = [-0.9, 0, 0, 0, 0]
    folded = replace(good, camera=good.camera.with_parameters(parameters))
    assert "turns back inside the picture" in advise(folded)[0]
    assert not says(good, "turns back")


def test_empty_thirds_are_named(good):
    views = tuple(replace(v, used=v.used & ~((v.xy[:, 0] < 214) & (v.xy[:, 1] < 161))) for v in good.views)
    (said,) = [t for t in advise(replace(good, views=views)) if "No corner in" in t]
    assert "upper left third of" in said
    views = tuple(replace(v, used=v.used & (v.xy[:, 0] < 426)) for v in good.views)
    (said,) = [t for t in advise(replace(good, views=views)) if "No corner in" in t]
    assert all(row[2] in said for row in THIRDS)
    assert "lower left" not in said


def test_many_outliers_are_counted(good):
    views = tuple(replace(v, used=v.used & (np.arange(len(v)) % 10 > 0)) for v in good.views)
    many = replace(good, views=views)
    (said,) = [t for t in advise(many) if "disagree" in t]
    assert said.startswith(f"{many.outliers} of {sum(len(v) for v in views)} corners")


def test_tilts_are_between_board_and_sensor():
    boards, poses = random_boards(BROWN, 3, 8, whole=True)
    found = calibrate(boards, SPACING, model="brown")
    true = np.degrees(np.arccos(np.abs([T[2, 2] for T in poses])))
    assert tilts(found) == pytest.approx(true, abs=2)


def test_boards_that_hardly_tilt_are_said():
    found = calibrate(random_boards(CAMERAS["pinhole"], 1, 10, 0.05, tilt=0.15)[0], SPACING, model="pinhole")
    assert says(found, "nearly faces the camera")
    assert says(found, "focal length is known only")
    assert found.advice[0].startswith("The focal length")
