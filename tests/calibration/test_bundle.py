"""Unknowns and residuals: exact slopes, the prior, and the same corners as those that simulated cameras see."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration.bundle import (
    DENOMINATOR,
    RADIAL,
    TANGENTIAL,
    Corners3,
    Prior,
    State,
    default_free,
    lens_prior,
    linearise,
    residuals,
)
from rcdn.calibration.motions import slopes_before
from rcdn.calibration.solver import Normal
from rcdn.geometry import rotation
from rcdn_lab.camera_scenes import CAMERAS, SPACING, labels, random_pose, see
from rcdn_lab.real_boards import uneven_board

T_RIGHT = np.array([[0.98, 0, 0.199, -0.1], [0, 1, 0, 0.01], [-0.199, 0, 0.98, 0.02], [0, 0, 0, 1]])


def two_cameras(seed=0, frames=4):
    """A state of a brown and a fisheye camera with a board of two functions, and corners of both with noise."""
    rng = np.random.default_rng(seed)
    poses = np.array([random_pose(rng, spread=0.2, tilt=0.5) for _ in range(frames)])
    u, _, vt = np.linalg.svd(T_RIGHT[:3, :3])
    rig = np.stack([np.eye(4), T_RIGHT])
    rig[1, :3, :3] = u @ vt
    shape = np.array([[0.001, -0.0005, 0.003], [0.0002, 0.0007, -0.002]])
    state = State((CAMERAS["brown"], CAMERAS["fisheye"]), poses, rig, shape)
    ij = labels()
    ups = ij / [4.0, 2.5] - 1
    frame, camera = np.repeat(np.tile(np.arange(frames), 2), 54), np.repeat([0, 1], frames * 54)
    board, basis = np.tile(ij * SPACING, (2 * frames, 1)), np.tile(1 - ups**2, (2 * frames, 1))
    corners = Corners3(frame, camera, board, np.zeros((len(frame), 2)), basis)
    xy = linearise(state, corners)[0]
    return state, Corners3(frame, camera, board, xy + rng.normal(0, 0.2, xy.shape), basis)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("away", [0.0, 0.15])
def test_slopes_in_all_unknowns_are_those_of_differences(away, late):
    """Also away from the start, where motions have led somewhere: slopes are about the state where it is; and where
    cameras may be late."""
    state, corners = two_cameras()
    rng = np.random.default_rng(3)
    if late:
        state = state.with_velocity(rng.normal(0, 0.05, (4, 6)))
    motions, shared = away * rng.normal(size=(4, 6)), np.zeros(sum(state.counts))
    motions[:, 3:] *= 0.3
    places = sum(state.counts[:2]) + np.arange(6)
    shared[places] = away * rng.normal(size=6) * [1, 1, 1, 0.3, 0.3, 0.3]
    shared[state.lateness] = [0.3, -0.9][: state.late.size]
    state = state.moved(motions, shared)
    _, by_frame, by_shared = linearise(state, corners)
    still, same = np.zeros((4, 6)), np.zeros(len(shared))

    def slope(of_motion, of_shared):
        ahead, behind = (linearise(state.moved(s * of_motion, s * of_shared), corners)[0] for s in (1e-6, -1e-6))
        return (ahead - behind) / 2e-6

    for k in range(6):
        d = np.zeros((4, 6))
        d[:, k] = 1
        assert by_frame[:, :, k] == pytest.approx(slope(d, same), rel=1e-5, abs=1e-3)
    for k in range(len(shared)):
        d = np.zeros(len(shared))
        d[k] = 1
        assert by_shared[:, :, k] == pytest.approx(slope(still, d), rel=1e-5, abs=1e-3)


def test_slopes_before_a_motion_are_those_of_the_moved_points():
    rng = np.random.default_rng(6)
    T, number, by_point = np.tile(np.eye(4), (3, 1, 1)), np.array([2, 0, 2, 1]), rng.normal(size=(4, 2, 3))
    T[:, :3, :3] = rotation(rng.normal(size=(3, 3)))
    expected = np.stack([slope @ T[k, :3, :3] for slope, k in zip(by_point, number, strict=True)])
    assert slopes_before(T, number, by_point) == pytest.approx(expected, abs=1e-14)


def test_residuals_are_observed_minus_the_pixels_of_linearise():
    state, corners = two_cameras()
    assert residuals(state, corners) == pytest.approx(corners.xy - linearise(state, corners)[0], abs=1e-12)


@pytest.mark.parametrize("cameras", [[0, 1], [1]], ids=["both", "one of two"])
def test_corners_may_come_in_any_order_and_of_some_cameras_only(cameras):
    state, every = two_cameras()
    corners = every.take(np.flatnonzero(np.isin(every.camera, cameras)))
    order = np.random.default_rng(1).permutation(len(corners))
    mixed = corners.take(order)
    assert all(isinstance(rows, slice) for rows in corners.rows.values())
    assert len(cameras) == 1 or not any(isinstance(rows, slice) for rows in mixed.rows.values())
    assert list(mixed.rows) == cameras
    assert residuals(state, mixed) == pytest.approx(residuals(state, corners)[order], abs=1e-12)
    for one, other in zip(linearise(state, mixed), linearise(state, corners), strict=True):
        assert one == pytest.approx(other[order], abs=1e-9)
    weight, free = np.linspace(1, 4, len(corners)), default_free(state, shape=True, rig=True)
    one, other = Normal.of(state, mixed, weight[order], free), Normal.of(state, corners, weight, free)
    assert one.blocks == pytest.approx(other.blocks, rel=1e-9, abs=1e-3)
    assert one.whole == pytest.approx(other.whole, rel=1e-9, abs=1e-3)
    assert one.gradient[1] == pytest.approx(other.gradient[1], rel=1e-9, abs=1e-3)
    dense = linearise(state, corners)
    own = (dense[1] * weight[:, None, None]).reshape(-1, 6)
    of_all = (dense[2] * weight[:, None, None]).reshape(len(own), -1)
    first = np.repeat(corners.frame == 0, 2)
    expected = np.hstack([own[first].T @ own[first], own[first].T @ of_all[first]])
    assert other.blocks[0] == pytest.approx(expected, rel=1e-9, abs=1e-3)


def test_a_late_camera_sees_boards_where_they_have_moved():
    """As by the poses after a moment's motion, times its lateness: to second order in the motion."""
    state, corners = two_cameras()
    velocity = np.random.default_rng(5).normal(0, 1e-4, (4, 6))
    later = state.moved(0.7 * velocity, np.zeros(sum(state.counts)))
    shared = np.zeros(sum(state.counts) + 2)
    shared[sum(state.counts[:3]) + 1] = 0.7
    late = state.with_velocity(velocity).moved(np.zeros((4, 6)), shared)
    second = corners.camera == 1
    assert residuals(late, corners)[second] == pytest.approx(residuals(later, corners)[second], abs=1e-4)
    assert residuals(late, corners)[~second] == pytest.approx(residuals(state, corners)[~second], abs=1e-12)
    assert np.abs(residuals(late, corners) - residuals(state, corners))[second].max() > 0.01


def test_moved_changes_the_values_by_what_it_is_told():
    state, _ = two_cameras()
    shared = np.random.default_rng(0).normal(size=sum(state.counts)) * 1e-3
    moved = state.moved(np.zeros((4, 6)), shared)
    places = np.zeros(len(shared), bool)
    places[-12:-6] = True  # the rig's values are motions from where it is
    assert (moved.values - state.values)[~places] == pytest.approx(shared[~places])
    assert (moved.values[places] == 0).all()
    assert moved.poses == pytest.approx(state.poses)
    assert moved.rig[0] == pytest.approx(np.eye(4))


def test_which_parameters_are_free():
    state, _ = two_cameras()
    assert state.counts == (9, 8, 6, 0, 6)
    full = [np.repeat(x, state.counts) for x in ([1, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 1])]
    assert default_free(state).tolist() == full[0].astype(bool).tolist()
    assert default_free(state, lens=False, rig=True).tolist() == full[1].astype(bool).tolist()
    assert default_free(state, shape=True, lens=False).tolist() == full[2].astype(bool).tolist()


def test_the_lens_prior_holds_what_distorts_and_nothing_else():
    camera = CAMERAS["rational"]
    state = State((camera, CAMERAS["brown"]), np.eye(4)[None], np.stack([np.eye(4)] * 2), np.zeros((2, 3)))
    prior = lens_prior(state)
    precision = np.diag(prior.precision)
    assert prior.precision.shape == (len(prior.mean),) * 2 == (sum(state.counts),) * 2
    assert np.array_equal(prior.precision, np.diag(precision))
    radial, tangential, denominator = (spread**-2 for spread in (RADIAL, TANGENTIAL, DENOMINATOR))
    brown = [radial, radial, tangential, tangential, radial]
    assert precision[:12] == pytest.approx([0, 0, 0, 0, *brown, *[denominator] * 3])
    assert precision[12:21] == pytest.approx([0, 0, 0, 0, *brown])
    assert (precision[21:] == 0).all()
    assert (prior.mean == 0).all()
    lenses = np.concatenate([camera.distortion, CAMERAS["brown"].distortion])
    spreads = np.concatenate([precision[4:12], precision[16:21]])
    assert prior.cost(state.values) == pytest.approx(lenses**2 @ spreads)


def test_the_slope_of_a_prior_is_that_of_half_its_cost():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4))
    prior, at = Prior(rng.normal(size=4), root @ root.T), rng.normal(size=4)
    slope = [(prior.cost(at + d) - prior.cost(at - d)) / 4e-6 for d in 1e-6 * np.eye(4)]
    assert prior.gradient(at) == pytest.approx(slope, rel=1e-6)
    assert prior.cost(prior.mean) == 0


def test_see_and_residuals_agree():
    """The simulated boards and the residuals speak of the same corners, uneven ones too."""
    rng = np.random.default_rng(5)
    T, offsets = random_pose(rng, spread=0.1), uneven_board(rng, 0.01, 0.0003, 0.002)
    ij, xy = see(CAMERAS["brown"], T, offsets=offsets)
    assert len(ij) == 54
    none = np.zeros(54, int)
    # every corner its own function
    corners = Corners3(none, none, ij * SPACING, xy, np.eye(54))
    assert residuals(State.mono(CAMERAS["brown"], T[None], offsets), corners) == pytest.approx(
        np.zeros((54, 2)), abs=1e-9
    )


def test_a_state_without_a_shape_ignores_the_functions():
    state, corners = two_cameras()
    flat = State(state.cameras, state.poses, state.rig)
    bare = Corners3(corners.frame, corners.camera, corners.board, corners.xy, corners.basis[:, :0])
    assert np.array_equal(residuals(flat, corners), residuals(flat, bare))
    assert linearise(flat, corners)[2].shape[2] == 9 + 8 + 6
