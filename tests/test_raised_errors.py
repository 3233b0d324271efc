"""A program may let NumPy raise all floating-point errors, underflow included: pictures give the same, and so do
cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.test_stereo import pairs
from tests.targets.coded_scene import charuco, seen

import rcdn
from rcdn.calibration import calibrate_rig, calibrate_stereo, estimate_pose, projection_uncertainty
from rcdn.calibration.bundle import Corners3, Prior, State, residuals
from rcdn.calibration.guidance import Guide
from rcdn.calibration.solver import solve
from rcdn.config import DetectorConfig
from rcdn.report.calibration import write_report, write_rig_report, write_stereo_report
from rcdn.synthetic import Background, Light, Scene, Sensor, camera_view, render
from rcdn.targets.circles import _models
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards
from rcdn_lab.paper.deltille import view_scene

BROWN = CAMERAS["brown"]


@pytest.fixture(autouse=True)
def raised():
    """All errors are raised, and what is computed once a process isn't there yet."""
    _models.cache_clear()
    with np.errstate(all="raise"):
        yield


def board():
    return render(camera_view(1, 1, (640, 480)), samples=2)


def faint():
    return np.rint(100 + board() * 3.0 / 255).astype(np.uint8)


def charuco_board():
    return seen(charuco(9, 7, "DICT_4X4_50"))[0]


def no_board():
    return render(Scene(640, 480, 500, (320, 240), sensor=Sensor(), background=Background("tiles", 1)))


@pytest.mark.parametrize(
    ("picture", "config", "count"),
    [
        (board, DetectorConfig(), 1),
        (board, DetectorConfig.paper(), 1),
        (faint, DetectorConfig(), 1),
        (charuco_board, DetectorConfig(), 1),
        (lambda: render(view_scene(3)), DetectorConfig(pattern="deltille"), 1),
        (no_board, DetectorConfig(), 0),
    ],
)
def test_boards_are_found_where_errors_are_raised(picture, config, count):
    assert len(rcdn.Detector(config).boards(picture())) == count


def test_glares_are_rendered_where_errors_are_raised():
    scene = replace(camera_view(1, 1, (640, 480)), light=Light(glares=((20, 20, 5, 0.5),)))
    assert render(scene, samples=1).max() == 255


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_a_camera_is_calibrated_and_used_where_errors_are_raised(tmp_path, model):
    boards = random_boards(CAMERAS[model], 1, views=8)[0]
    found = rcdn.calibrate(boards, SPACING, model=model)
    assert found.rms < 0.4
    write_report(tmp_path / "a.html", found)
    assert estimate_pose(boards[0], found.camera, spacing=SPACING).rms < 1
    assert projection_uncertainty(found, found.camera.project([[0, 0, 1.0]]))[0] < 1
    assert found.camera.undistort(board(), 1).shape == (480, 640)


def test_a_guide_guides_where_errors_are_raised():
    boards = random_boards(BROWN, 1, views=8, whole=True)[0]
    guide = Guide(BROWN.image_size, SPACING, model="brown")
    guide.add_all({f"{k}.png": one for k, one in enumerate(boards[:-1])})
    assert guide.look(boards[-1], 0.0, board()).hint


def test_pairs_and_rigs_are_calibrated_where_errors_are_raised(tmp_path):
    left, right = pairs(BROWN, BROWN)
    pair = calibrate_stereo(left, right, SPACING, model="brown")
    assert pair.rms < 0.4
    write_stereo_report(tmp_path / "a.html", pair)
    rig = calibrate_rig({"a": left, "b": right}, SPACING, model="brown")
    assert rig.rms < 0.4
    write_rig_report(tmp_path / "b.html", rig)


def test_a_solution_all_but_at_its_prior_is_found_where_errors_are_raised():
    boards, poses = random_boards(CAMERAS["pinhole"], 1, views=4, noise=0.0, whole=True)
    frame = np.repeat(np.arange(4), [len(one) for one in boards])
    ij, xy = np.concatenate([one.ij for one in boards]), np.concatenate([one.xy for one in boards])
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 2)))
    state = State.mono(Camera(CAMERAS["pinhole"].K, None, (640, 480), "brown"), np.array(poses))
    prior = Prior(state.values + 1e-170 * (state.values == 0), np.eye(len(state.values)))
    found = solve(replace(state, prior=prior), corners, np.ones(len(frame)), free=np.zeros(len(state.values), bool))
    assert np.abs(residuals(found.state, corners)).max() < 1e-6
