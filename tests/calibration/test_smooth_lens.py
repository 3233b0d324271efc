"""A smooth correction beside a lens model: ripples that no coefficient follows, and what was held fixed."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.bundle import State, lens_prior
from rcdn.calibration.smooth_lens import Bending, with_correction
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards

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


def test_ripples_are_followed_where_no_coefficient_does(rippled):
    plain = calibrate(rippled, SPACING, model="brown", flat=True)
    smooth = calibrate(rippled, SPACING, model="splined", flat=True)
    assert smooth.camera.correction is not None
    assert smooth.models[0].model.endswith("with spline")
    assert smooth.rms < 0.35 * plain.rms
    assert smooth.held_out < 0.5 * plain.held_out


def test_what_is_held_fixed_stays_fixed_beside_a_correction(rippled):
    done = calibrate(rippled, SPACING, model="splined", flat=True, fix=("principal_point",))
    assert done.camera.parameters[2:4] == pytest.approx([319.5, 239.5], abs=1e-3)


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
