"""The least squares: slopes against differences, the arrow against the dense inverse, and the solution against OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rcdn.calibration.bundle import (
    DENOMINATOR,
    Arrow,
    Corners3,
    Moved,
    State,
    default_free,
    linearise,
    residuals,
    solve,
)
from rcdn.evaluation.camera_scenes import CAMERAS, SPACING, labels, random_boards, random_pose, see
from rcdn.types import Camera

T_RIGHT = np.array([[0.98, 0, 0.199, -0.1], [0, 1, 0, 0.01], [-0.199, 0, 0.98, 0.02], [0, 0, 0, 1]])


def two_cameras(seed=0, frames=4):
    """A state of a brown and a fisheye camera with a bent board, and corners of both with noise."""
    rng = np.random.default_rng(seed)
    poses = np.array([random_pose(rng, spread=0.2, tilt=0.5) for _ in range(frames)])
    u, _, vt = np.linalg.svd(T_RIGHT[:3, :3])
    rig = np.stack([np.eye(4), T_RIGHT])
    rig[1, :3, :3] = u @ vt
    state = State((CAMERAS["brown"], CAMERAS["fisheye"]), poses, rig, np.array([0.003, -0.002]))
    ij = labels()
    ups = ij / [4.0, 2.5] - 1
    n = len(ij)
    frame = np.repeat(np.tile(np.arange(frames), 2), n)
    camera = np.repeat([0, 1], frames * n)
    board, bend = np.tile(ij * SPACING, (2 * frames, 1)), np.tile(1 - ups**2, (2 * frames, 1))
    corners = Corners3(frame, camera, board, np.zeros((len(frame), 2)), bend)
    xy = linearise(state, corners)[0]
    return state, Corners3(frame, camera, board, xy + rng.normal(0, 0.2, xy.shape), bend)


def mono(model, seed=0, views=8, noise=0.2, whole=True):
    """A start near the truth, and the corners of random boards."""
    boards, poses = random_boards(CAMERAS[model], seed, views, noise, whole=whole)
    lengths = [len(b) for b in boards]
    ij, xy = np.concatenate([b.ij for b in boards]), np.concatenate([b.xy for b in boards])
    frame = np.repeat(np.arange(views), lengths)
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 2)))
    return State.mono(CAMERAS[model], np.array(poses)), corners


@pytest.mark.parametrize("away", [0.0, 0.15])
def test_slopes_in_all_unknowns_are_those_of_differences(away):
    """Also away from the start, where the motions have led somewhere."""
    state, corners = two_cameras()
    rng = np.random.default_rng(3)
    motions, shared = away * rng.normal(size=(4, 6)), np.zeros(sum(state.counts))
    motions[:, 3:] *= 0.3
    places = slice(-8, -2)
    shared[places] = away * rng.normal(size=6) * [1, 1, 1, 0.3, 0.3, 0.3]
    _, by_frame, by_shared = linearise(
        state.moved(motions, shared), corners, Moved(motions, shared[places].reshape(-1, 6))
    )
    pixels = lambda m, s: linearise(state.moved(m, s), corners)[0]  # noqa: E731
    for k in range(6):
        d = np.zeros((4, 6))
        d[:, k] = 1e-6
        slope = (pixels(motions + d, shared) - pixels(motions - d, shared)) / 2e-6
        assert by_frame[:, :, k] == pytest.approx(slope, rel=1e-5, abs=1e-3)
    for k in range(len(shared)):
        d = np.zeros(len(shared))
        d[k] = 1e-6
        slope = (pixels(motions, shared + d) - pixels(motions, shared - d)) / 2e-6
        assert by_shared[:, :, k] == pytest.approx(slope, rel=1e-5, abs=1e-3)


def test_the_arrow_is_the_inverse_of_the_normal_matrix():
    rng = np.random.default_rng(0)
    frames, shared, n = 3, 5, 40
    frame = np.repeat(np.arange(frames), n)
    a, b = rng.normal(size=(3 * n, 2, 6)), rng.normal(size=(3 * n, 2, shared))
    firm = np.array([0, 0, 0, 2.0, 0])
    arrow = Arrow.of(a, b, frame, frames, firm)
    dense = np.zeros((3 * n, 2, 6 * frames + shared))
    for k, f in enumerate(frame):
        dense[k, :, 6 * f : 6 * f + 6] = a[k]
    dense[:, :, 6 * frames :] = b
    flat = dense.reshape(6 * n, -1)
    normal = flat.T @ flat
    normal[6 * frames :, 6 * frames :] += np.diag(firm**2)
    factor = np.stack(
        [np.concatenate([m.ravel(), s]) for m, s in (arrow.apply(e) for e in np.eye(6 * frames + shared))], axis=1
    )
    assert factor @ factor.T == pytest.approx(np.linalg.inv(normal), rel=1e-9, abs=1e-12)
    own, rim = arrow.slopes(a, b, frame)
    whitened = np.zeros_like(dense)
    for k, f in enumerate(frame):
        whitened[k, :, 6 * f : 6 * f + 6] = own[k]
    whitened[:, :, 6 * frames :] = rim
    assert whitened.reshape(6 * n, -1) == pytest.approx(flat @ factor, abs=1e-9)


def test_what_no_corner_tells_of_does_not_move():
    state, corners = mono("brown", views=4)
    bent = default_free(state, warp=True)  # flat boards: the bend is zero, so the warp changes nothing
    assert (solve(state, corners, np.full(len(corners), 5.0), bent).state.warp == 0).all()


def test_a_frame_without_corners_keeps_its_pose():
    state, corners = mono("brown", views=4)
    done = solve(state, corners.take(corners.frame != 2), np.full(int((corners.frame != 2).sum()), 5.0)).state
    assert np.array_equal(done.poses[2], state.poses[2])
    assert not np.array_equal(done.poses[1], state.poses[1])


def test_corners_without_weight_do_not_pull():
    state, corners = mono("brown", views=5)
    xy = corners.xy.copy()
    xy[::7] += 100
    spoilt = Corners3(corners.frame, corners.camera, corners.board, xy, corners.bend)
    weight = np.where(np.arange(len(xy)) % 7, 5.0, 0.0)
    a, b = (solve(state, c, weight).state for c in (corners, spoilt))
    assert b.cameras[0].parameters == pytest.approx(a.cameras[0].parameters, rel=1e-9, abs=1e-9)


FLAGS = {"pinhole": 0, "brown": 0, "rational": cv2.CALIB_RATIONAL_MODEL}
NO_LENS = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational"])
def test_the_solution_is_that_of_opencv(model):
    state, corners = mono(model, seed=1)
    done = solve(state, corners, np.full(len(corners), 5.0))
    gaps = residuals(done.state, corners)
    rms = np.sqrt((gaps**2).sum(axis=1).mean())
    board = np.column_stack([corners.board, np.zeros(len(corners))]).astype(np.float32)
    views = range(len(state.poses))
    flags = FLAGS[model] | (NO_LENS if model == "pinhole" else 0)
    theirs = cv2.calibrateCameraExtended(
        [board[corners.frame == f] for f in views],
        [corners.xy[corners.frame == f].astype(np.float32) for f in views],
        (640, 480), state.cameras[0].K.copy(), state.cameras[0].distortion.copy(), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-15),
    )  # fmt: skip
    assert rms < theirs[0] + 1e-3
    if model == "rational":
        return  # its numbers are held together by what is believed beforehand, which OpenCV doesn't do
    assert rms == pytest.approx(theirs[0], abs=1e-4)
    K, std = theirs[1], np.sqrt(np.diag(done.arrow.rim @ done.arrow.rim.T))
    theirs_all = np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(theirs[2])[: len(std) - 4]])
    off = np.abs(done.state.cameras[0].parameters - theirs_all) / std
    assert off.max() < 0.05


@pytest.mark.parametrize("model", CAMERAS)
def test_exact_corners_give_the_truth_from_a_rough_start(model):
    state, corners = mono(model, seed=2, noise=0.0)
    rng = np.random.default_rng(4)
    camera = state.cameras[0]
    rough = camera.with_parameters(
        np.concatenate([camera.parameters[:4] * [1.1, 1.1, 0.95, 1.05], 0 * camera.distortion])
    )
    motions = rng.normal(0, 0.02, (8, 6))
    start = State.mono(rough, state.moved(motions, np.zeros(sum(state.counts))).poses)
    done = solve(start, corners, np.full(len(corners), 1e3)).state
    assert np.abs(residuals(done, corners)).max() < (1e-2 if model == "rational" else 1e-6)
    if model != "rational":
        assert done.cameras[0].parameters == pytest.approx(camera.parameters, rel=1e-6, abs=1e-6)


def test_soft_loss_holds_against_outliers():
    state, corners = mono("brown", seed=3)
    xy = corners.xy.copy()
    xy[::20] += 30
    spoilt = Corners3(corners.frame, corners.camera, corners.board, xy, corners.bend)
    weight = np.full(len(xy), 5.0)
    off = {}
    for loss in ("linear", "soft_l1"):
        done = solve(state, spoilt, weight, loss=loss).state
        off[loss] = np.abs(done.cameras[0].parameters - state.cameras[0].parameters)[:4].max()
    assert off["soft_l1"] < 3 < off["linear"]


def test_belief_holds_the_denominator_only():
    camera = CAMERAS["rational"]
    state = State((camera, CAMERAS["brown"]), np.eye(4)[None], np.stack([np.eye(4)] * 2), np.zeros(2))
    value, firm = state.belief
    assert len(value) == len(firm) == sum(state.counts)
    assert np.flatnonzero(firm).tolist() == [9, 10, 11]
    assert firm[9] == pytest.approx(1 / DENOMINATOR)
    assert value[9:12] == pytest.approx(camera.distortion[-3:])


def test_see_and_linearise_agree():
    """The simulated boards and the residuals speak of the same corners, bent ones too."""
    T = random_pose(np.random.default_rng(5), spread=0.1)
    ij, xy = see(CAMERAS["brown"], T, warp=(0.004, -0.003))
    ups = ij / [4.0, 2.5] - 1
    corners = Corners3(np.zeros(len(ij), int), np.zeros(len(ij), int), ij * SPACING, xy, 1 - ups**2)
    state = State.mono(CAMERAS["brown"], T[None], np.array([0.004, -0.003]))
    assert residuals(state, corners) == pytest.approx(np.zeros((len(ij), 2)), abs=1e-9)


def test_blind_corners_are_expensive_but_do_not_stop_the_solver():
    """A start that puts a board behind the camera: NaN residuals, no crash."""
    state, corners = mono("brown", views=4)
    poses = state.poses.copy()
    poses[0, 2, 3] = -0.5
    done = solve(State.mono(Camera(CAMERAS["brown"].K, np.zeros(5), (640, 480)), poses), corners, np.ones(len(corners)))
    assert np.isfinite(done.state.cameras[0].parameters).all()
    assert np.isnan(residuals(done.state, corners)[corners.frame == 0]).any()
