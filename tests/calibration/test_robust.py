"""Wrong corners and wrong views are found, good ones are kept, and the noise is that which was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate, robust
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards, random_pose, see

BROWN = CAMERAS["brown"]


def marked(model, seed, views=12, share=0.05, noise=0.2):
    """Boards with gross errors of 5 to 40 px, and for each a mask of the corners that are wrong."""
    boards, _ = random_boards(CAMERAS[model], seed, views, noise)
    rng = np.random.default_rng(seed + 100)
    spoilt, masks = [], []
    for b in boards:
        wrong, angle = rng.random(len(b)) < share, rng.uniform(0, 2 * np.pi, len(b))
        away = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(5, 40, len(b))[:, None]
        spoilt.append(replace(b, xy=b.xy + away * wrong[:, None]))
        masks.append(wrong)
    return spoilt, masks


def z_of(found, camera):
    return (found.camera.parameters - camera.parameters) / found.std


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_gross_errors_are_left_out_and_good_corners_are_not(model):
    boards, masks = marked(model, 1)
    found = calibrate(boards, SPACING, model=model)
    assert not found.left_out
    wrong, used = np.concatenate(masks), np.concatenate([v.used for v in found.views])
    assert wrong.sum() > 15
    assert not used[wrong].any()
    assert (~used & ~wrong).sum() <= 1
    assert found.outliers == (~used).sum()
    assert np.abs(z_of(found, CAMERAS[model])).max() < 4


@pytest.mark.parametrize("given", [True, False], ids=["sigma", "no sigma"])
def test_the_noise_is_that_which_was_put_in(given):
    """With sigma the noise beyond it is nothing; without it is all. NaN sigma is like none."""
    boards, _ = marked("brown", 2, noise=0.3)
    sigma = None if given else np.nan
    if not given:
        boards = [replace(b, sigma=np.full(len(b), sigma)) for b in boards]
    found = calibrate(boards, SPACING, model="brown")
    if given:
        assert found.noise < 0.1
    else:
        assert found.noise == pytest.approx(0.3, rel=0.1)
    assert found.rms == pytest.approx(0.3 * np.sqrt(2), rel=0.1)


def test_noise_beyond_a_sigma_that_is_too_small():
    boards, _ = random_boards(BROWN, 3, 12, noise=0.3)
    found = calibrate([replace(b, sigma=np.full(len(b), 0.1)) for b in boards], SPACING, model="brown")
    assert found.noise == pytest.approx(np.sqrt(0.3**2 - 0.1**2), rel=0.1)


def test_a_sigma_that_is_too_large_does_not_spoil_the_deviations():
    """Their scale is that of the residuals."""
    boards, _ = random_boards(BROWN, 3, 10, noise=0.1)
    right = calibrate(boards, SPACING, model="brown", flat=True)
    wide = calibrate([replace(b, sigma=np.full(len(b), 0.5)) for b in boards], SPACING, model="brown", flat=True)
    assert wide.std == pytest.approx(right.std, rel=0.05)
    assert wide.camera.parameters == pytest.approx(right.camera.parameters, abs=0.1 * right.std.max(), rel=1e-3)


def test_boards_of_two_noise_levels_are_weighted():
    """Half of the views are five times worse: with their sigma they hardly matter, and are no outliers."""
    quiet, _ = random_boards(BROWN, 4, 8, noise=0.1)
    loud, _ = random_boards(BROWN, 5, 8, noise=0.5)
    found = calibrate([*quiet, *loud], SPACING, model="brown")
    alone = calibrate(quiet, SPACING, model="brown")
    assert found.std[:4] == pytest.approx(alone.std[:4], rel=0.3)
    assert (found.std < 1.02 * alone.std).all()  # more corners never tell less
    assert not found.left_out
    assert np.abs(z_of(found, BROWN)).max() < 4
    assert found.outliers <= 2


@pytest.mark.parametrize(("model", "bad"), [("pinhole", 1), ("brown", 1), ("brown", 2), ("fisheye", 2)])
def test_views_with_scrambled_labels_are_left_out_and_no_other(model, bad):
    boards, _ = random_boards(CAMERAS[model], 2, 12)
    rng = np.random.default_rng(0)
    spoilt = [replace(b, xy=b.xy[rng.permutation(len(b))]) if k < bad else b for k, b in enumerate(boards)]
    found = calibrate(spoilt, SPACING, model=model)
    assert [bool(v.reason) for v in found.views] == [k < bad for k in range(12)]
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.1)
    assert np.abs(z_of(found, CAMERAS[model])).max() < 4


def test_scrambled_labels_are_not_called_mirrored():
    boards, _ = random_boards(CAMERAS["pinhole"], 2, 6)
    rng = np.random.default_rng(0)
    scrambled = replace(boards[0], xy=boards[0].xy[rng.permutation(len(boards[0]))])
    found = calibrate([scrambled, *boards[1:]], SPACING, model="pinhole")
    assert "mirrored" not in found.views[0].reason


def test_a_board_that_moved_is_left_out_with_a_reason_that_says_how_far():
    boards, _ = random_boards(BROWN, 3, 12)
    first = boards[0]
    late = first.ij[:, 0] > first.ij[:, 0].max() / 2
    moved = replace(first, xy=first.xy + late[:, None] * [12.0, 5.0])
    found = calibrate([moved, *boards[1:]], SPACING, model="brown")
    assert [k for k, v in enumerate(found.views) if v.reason] == [0]
    assert "px" in found.views[0].reason
    assert found.views[0].pose is not None
    assert not found.views[0].used.any()
    assert np.abs(z_of(found, BROWN)).max() < 4


def test_a_zoomed_picture_is_left_out():
    """One near view by a camera of the same size, but with another lens."""
    boards, _ = random_boards(BROWN, 6, 11, whole=True)
    rng = np.random.default_rng(1)
    camera = replace(CAMERAS["rational"], distortion=[0.0, 0, 0, 0, 0], model="brown")
    while True:
        ij, xy = see(camera, random_pose(rng, 0.3, 0.8, (0.25, 0.3)))
        if len(ij) == 54:
            break
    other = replace(boards[0], ij=ij, xy=xy, sigma=np.full(54, 0.2), response=np.ones(54), status=np.zeros(54))
    found = calibrate([*boards, other], SPACING, model="brown")
    assert [bool(v.reason) for v in found.views] == [False] * 11 + [True]


def test_a_pose_in_the_wrong_one_of_a_planes_two_is_turned():
    boards, truth = random_boards(BROWN, 7, 6, whole=True)
    lengths = [len(b) for b in boards]
    frame = np.repeat(np.arange(6), lengths)
    corners = Corners3(
        frame, 0 * frame, np.concatenate([b.ij for b in boards]) * SPACING, np.concatenate([b.xy for b in boards]),
        np.zeros((len(frame), 2)),
    )  # fmt: skip
    right = State.mono(BROWN, np.array(truth))
    wrong = robust._flipped(right, corners, np.array([0, 3]))
    assert np.abs(wrong.poses[[0, 3], :3, :3] - right.poses[[0, 3], :3, :3]).max(axis=(1, 2)).min() > 0.2
    sigma, free = np.full(len(frame), 0.2), default_free(right)
    state, noise = robust.initial_fit(wrong, corners, sigma, free)
    done = robust.fit(state, noise, corners, sigma, free)
    assert not any(done.reasons)
    assert done.state.poses[:, :3, :3] == pytest.approx(right.poses[:, :3, :3], abs=0.02)


def test_flipping_keeps_the_middle_and_comes_back():
    boards, truth = random_boards(BROWN, 8, 3, whole=True)
    frame = np.repeat(np.arange(3), 54)
    corners = Corners3(
        frame, 0 * frame, np.tile(boards[0].ij * SPACING, (3, 1)), np.zeros((162, 2)), np.zeros((162, 2))
    )
    state = State.mono(BROWN, np.array(truth))
    once = robust._flipped(state, corners, np.arange(3))
    middle = np.array([*(boards[0].ij * SPACING).mean(axis=0), 0, 1])
    assert once.poses @ middle == pytest.approx(state.poses @ middle, abs=1e-12)
    assert robust._flipped(once, corners, np.arange(3)).poses == pytest.approx(state.poses, abs=1e-9)


def test_the_fit_says_what_it_rests_on():
    boards, masks = marked("brown", 9, views=6)
    frame = np.repeat(np.arange(6), [len(b) for b in boards])
    corners = Corners3(
        frame, 0 * frame, np.concatenate([b.ij for b in boards]) * SPACING, np.concatenate([b.xy for b in boards]),
        np.zeros((len(frame), 2)),
    )  # fmt: skip
    offsets = [b.ij.min(axis=0) for b in boards]
    assert all((o == 0).all() for o in offsets)
    _, truth = random_boards(BROWN, 9, 6, 0.2)
    sigma = np.full(len(frame), 0.2)
    start = State.mono(BROWN, np.array(truth))
    state, noise = robust.initial_fit(start, corners, sigma, default_free(start))
    done = robust.fit(state, noise, corners, sigma, default_free(start))
    assert (done.weight > 0).tolist() == done.used.tolist()
    assert done.residuals == pytest.approx(residuals(done.state, corners), nan_ok=True)
    whitened = ((done.residuals[done.used] * done.weight[done.used, None]) ** 2).sum()
    assert done.scale == pytest.approx(
        whitened / (2 * done.used.sum() - 6 * 6 - 9), rel=1e-4
    )  # lens coefficients have weak priors
    assert 0.8 < done.scale < 1.2
    assert not done.used[np.concatenate(masks)].any()
