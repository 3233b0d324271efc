"""What views can't settle is told; what they settle isn't doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.observability import deviations, tilt, undetermined
from rcdn.errors import CalibrationError
from rcdn.geometry import rotation
from rcdn.types import Pose
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, see

PINHOLE = CAMERAS["pinhole"]


def tilted(degrees, views, seed=0, noise=0.1, one_axis=False, camera=PINHOLE):
    """Boards tilted by `degrees` × 0.6 to 1, to any side or about one axis."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < views:
        z, angle = rng.uniform(0.35, 0.7), np.radians(degrees) * rng.uniform(0.6, 1)
        side = rng.choice([0, np.pi]) if one_axis else rng.uniform(0, 2 * np.pi)
        R = rotation(np.array([np.cos(side), np.sin(side), 0]) * angle) @ rotation(np.array([0, 0, rng.normal(0, 0.5)]))
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = np.array([*rng.uniform(-0.35, 0.35, 2) * [1, 0.75] * z, z]) - R @ [0.12, 0.075, 0]
        ij, xy = see(camera, T)
        if len(ij) >= 40:
            out.append(board(ij, xy + rng.normal(0, noise, xy.shape), (640, 480), np.full(len(xy), noise)))
    return out


@pytest.mark.parametrize(("degrees", "model"), [(20, "pinhole"), (30, "pinhole"), (30, "brown")])
@pytest.mark.parametrize("views", [4, 10])
def test_tilted_boards_settle_everything(degrees, model, views):
    done = calibrate(tilted(degrees, views, views), SPACING, model=model)
    assert undetermined(done) == ()
    assert abs(np.log(done.camera.K[0, 0] / 520)) < 4 * deviations(done)[0] + 0.005


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("degrees", "noise"), [(5, 0.5), (3, 0.3)])
def test_boards_that_face_the_camera_do_not_settle_the_focal_length(seed, degrees, noise):
    try:
        done = calibrate(tilted(degrees, 8, seed, noise), SPACING, model="pinhole")
    except CalibrationError:  # it knows itself
        return
    first, *_ = undetermined(done)
    assert first.quantity == "focal length"
    assert first.deviation > 0.05
    assert "faces the camera in all 8 views" in first.finding
    assert "Tilt it by 30°" in first.remedy


def test_the_deviation_is_that_of_repeated_calibrations():
    """The scatter over sets of other poses and other noise; the deviation holds within a factor."""
    errors, stated = [], []
    for seed in range(8):
        done = calibrate(tilted(12, 8, seed), SPACING, model="pinhole")
        errors.append(np.log(done.camera.K[0, 0] / 520))
        stated.append(deviations(done)[0])
    assert 0.5 < np.median(stated) / np.sqrt(np.mean(np.square(errors))) < 2.5


def test_views_without_tilt_tell_nothing_even_if_they_agree():
    done = calibrate(tilted(30, 6), SPACING, model="pinhole")
    views = []
    for view in done.views:
        T = np.eye(4)
        T[:3, 3] = view.pose.t
        views.append(replace(view, pose=Pose(T)))
    flat = replace(done, views=tuple(views))
    assert tilt(flat) == pytest.approx((0, 0), abs=1e-6)
    first, *_ = undetermined(flat)
    assert first.quantity == "focal length"
    assert "any value fits" in first.finding


def test_tilt_to_one_side_is_told_from_tilt_to_all():
    most, least = tilt(calibrate(tilted(30, 10), SPACING, model="pinhole"))
    assert 20 < most < 33
    assert least > 10
    _, least = tilt(calibrate(tilted(30, 10, one_axis=True), SPACING, model="pinhole"))
    assert least < 5


def test_what_was_held_fixed_is_settled():
    done = calibrate(tilted(30, 6), SPACING, model="pinhole")
    cov = done.cov.copy()
    cov[2:4], cov[:, 2:4] = 0.0, 0.0
    fixed = deviations(replace(done, cov=cov))
    assert (fixed[2:] < 1e-2 * deviations(done)[2:]).all()
    assert fixed[0] == pytest.approx(deviations(done)[0], rel=0.9)
