"""A smooth correction beside a lens model: ripples that no coefficient follows, and what was held fixed."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from jackknife import deviations
from typer.testing import CliRunner

from rcdn.calibration import calibrate, estimate_pose
from rcdn.calibration.bundle import State, lens_prior
from rcdn.calibration.difference import agreement, camera_difference
from rcdn.calibration.influence import view_information
from rcdn.calibration.plain_lens import plain_fit
from rcdn.calibration.smooth_lens import Bending, with_correction
from rcdn.cli import app
from rcdn.geometry.spline_grid import frame_pixels
from rcdn.io import lens_fit, write_calibration
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards

pytestmark = pytest.mark.xdist_group("smooth lens")  # one correction that most of them look at
BROWN, NOISE = CAMERAS["brown"], 0.03


@pytest.fixture(scope="module")
def rippled():
    """Boards under a lens with ripples of .8 px, 200 px long."""
    rng, boards = np.random.default_rng(1), random_boards(BROWN, 3, 16, noise=0.0, whole=True)[0]
    out = []
    for b in boards:
        waves = 0.8 * np.stack([np.sin(2 * np.pi * b.xy[:, 1] / 200), np.cos(2 * np.pi * b.xy[:, 0] / 200)], axis=1)
        xy = b.xy + waves + rng.normal(0, NOISE, b.xy.shape)
        out.append(board(b.ij, xy, b.image_size, np.full(len(xy), NOISE)))
    return out


@pytest.fixture(scope="module")
def plain(rippled):
    return calibrate(rippled, SPACING, model="brown", flat=True)


@pytest.fixture(scope="module")
def smooth(rippled):
    return calibrate(rippled, SPACING, model="splined", flat=True)


def test_ripples_are_followed_where_no_coefficient_does(plain, smooth):
    assert smooth.camera.correction is not None
    assert smooth.models[0].model.endswith("with spline")
    assert smooth.rms < 0.35 * plain.rms
    assert smooth.held_out < 0.5 * plain.held_out


def test_what_is_held_fixed_stays_fixed_beside_a_correction(rippled):
    done = calibrate(rippled, SPACING, model="splined", flat=True, fix=("principal_point",))
    assert done.camera.parameters[2:4] == pytest.approx([319.5, 239.5], abs=1e-3)
    assert plain_fit("a.yaml", done).held.parameters[2:4] == pytest.approx([319.5, 239.5], abs=1e-3)


@pytest.fixture(scope="module")
def near_the_middle(rippled):
    """The corners within 200 px of the middle: beyond them a correction is not determined."""
    out = []
    for b in rippled:
        some = np.linalg.norm(b.xy - (319.5, 239.5), axis=1) < 200
        if some.sum() >= 12:
            out.append(board(b.ij[some], b.xy[some], b.image_size, b.sigma[some]))
    return out


def test_a_file_of_coefficients_holds_what_the_corners_give_without_a_correction(near_the_middle):
    """The lens nearest to the corrected one over the whole frame follows what the correction extrapolates instead."""
    whole = {"size": (9, 6), "flat": True}
    smooth = calibrate(near_the_middle, SPACING, model="splined", **whole)
    plain = calibrate(near_the_middle, SPACING, model="brown", **whole)
    found, nearest = plain_fit("a.yaml", smooth), lens_fit("a.yaml", smooth.camera)
    assert found.solved
    assert found.held.correction is None
    assert "solved from the same pictures" in found.text
    frame = frame_pixels(smooth.camera.image_size, 41)
    at_corners = camera_difference(found.held, smooth.camera, frame[[0, 40, -41, -1]], fit=frame).lengths.max()
    assert found.largest == pytest.approx(at_corners)  # where it is largest here: "over the frame" is up to its border

    def error(camera):
        gaps = [estimate_pose(b, camera, SPACING).rms for b in near_the_middle]
        return float(np.sqrt(np.mean(np.square(gaps))))

    assert error(found.held) < 1.02 * error(plain.camera)
    assert error(found.held) < error(nearest.held)


def convert(done, folder, *options):
    write_calibration(folder / "c.json", done)
    return CliRunner().invoke(app, ["convert", str(folder / "c.json"), str(folder / "a.yaml"), *options])


def test_formats_with_a_correction_of_their_own_need_no_other_lens(plain, smooth, tmp_path):
    assert plain_fit("a.json", smooth) is None
    assert not plain_fit("a.cameramodel", smooth).solved
    refused, written = (convert(smooth, tmp_path, *lossy) for lossy in ((), ("--lossy",)))
    assert (refused.exit_code, written.exit_code) == (1, 0)
    told = plain_fit(str(tmp_path / "a.yaml"), smooth).text
    assert told in refused.stderr  # what --lossy would write is what it writes
    assert told in written.stderr
    assert plain_fit("a.yaml", plain) is None


def test_flat_corrections_cost_and_bent_ones_of_the_typical_size_cost_one():
    """Constant and linear corrections would only repeat focal length and principal point."""
    state = State.mono(BROWN, np.eye(4)[None])
    camera = with_correction(state).cameras[0]
    bending, (rows, columns, _) = Bending.of(camera), camera.correction.control.shape
    flat = np.zeros((rows, columns, 2))
    flat[:, :, 0] = np.arange(columns) - (columns - 1) / 2
    flat /= np.linalg.norm(flat)
    assert flat.ravel() @ bending.energy @ flat.ravel() > 1e6
    assert bending.many == 2 * rows * columns - 6
    assert np.linalg.eigvalsh(bending.energy).min() > 0
    assert len(lens_prior(with_correction(state)).mean) == len(camera.parameters)


def test_views_tell_of_a_corrected_lens_under_the_prior_of_its_bending(smooth):
    """Without it control points that no corner tells of leave the focal length open by thousands of pixels."""
    found = deviations(view_information(smooth).at_optimum())
    assert (found[:4] < 4 * smooth.std[:4]).all()


def test_a_corrected_camera_agrees_with_itself(smooth):
    found = agreement(smooth, smooth, camera_difference(smooth.camera, smooth.camera))
    assert found.rms < 1e-3


def test_a_correction_that_was_asked_for_and_is_not_taken_is_told(rippled, monkeypatch):
    module = import_module("rcdn.calibration.calibrate")  # the package's name for it is the function's
    monkeypatch.setattr(module, "_splined", lambda *_, **__: None)
    done = calibrate(rippled, SPACING, model="splined", flat=True)
    assert done.camera.correction is None
    assert f"it is that of {done.camera.model} alone" in done.advice[-1]
    assert not any("smooth correction" in line for line in calibrate(rippled, SPACING, flat=True).advice)
