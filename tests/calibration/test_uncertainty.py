"""Stated deviations against the spread of repeated calibrations, and where corners were."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from rcdn.calibration import calibrate, coverage, projection_uncertainty, uncertainty
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.solver import solve
from rcdn.calibration.uncertainty import Clustered, clustered, covariance
from rcdn.errors import RcdnError
from rcdn.geometry import project, rotation, unproject
from rcdn.types import BoardView, Calibration, Pose
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, labels, random_boards, random_pose, see
from rcdn_lab.real_boards import smooth_error
from rcdn_lab.trust import BOARDS, row, trust

PINHOLE, RUNS, NOISE = CAMERAS["pinhole"], 60, 0.2
PIXELS = np.array([[320.0, 240], [30, 30], [600, 450]])


def poses_of(seed, many=5):
    """(poses, exact pixels) of whole boards."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < many:
        T = random_pose(rng, 0.3, 0.8)
        ij, xy = see(PINHOLE, T)
        if len(ij) == 54:
            out.append((T, xy))
    return np.array([T for T, _ in out]), np.concatenate([xy for _, xy in out])


TRUE_POSES, EXACT = poses_of(4)


@dataclass(frozen=True)
class Run:
    """What noise of one seed gives: a calibration without views, and the boards' mean motion (6,)
    from where they truly stand."""

    found: Calibration
    motion: np.ndarray


def solved(poses, exact, seed):
    """Least squares from the truth, with the covariance that a calibration states."""
    xy = exact + np.random.default_rng(seed).normal(0, NOISE, exact.shape)
    frame = np.repeat(np.arange(len(poses)), 54)
    corners = Corners3(frame, 0 * frame, np.tile(labels() * SPACING, (len(poses), 1)), xy, 0 * xy)
    done = solve(State.mono(PINHOLE, poses), corners, np.full(len(xy), 1 / NOISE))
    cov = covariance(done.arrow, np.arange(len(poses)), 1.0, Clustered(done.arrow.covariance, 1.0))
    motion = np.mean([small_motion(T, true) for T, true in zip(done.state.poses, poses, strict=True)], axis=0)
    return Run(Calibration(done.state.cameras[0], SPACING, (), cov, NOISE, ()), motion)


@cache
def runs():
    """The same boards again and again with other noise."""
    return [solved(TRUE_POSES, EXACT, seed) for seed in range(RUNS)]


def small_motion(T, truth):
    D = T[:3, :3] @ truth[:3, :3].T
    turn = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
    return np.concatenate([turn, T[:3, 3] - D @ truth[:3, 3]])


def test_a_calibration_states_that_covariance():
    """The whole way, noise estimated and by the scatter of 40 views, gives about the covariance of the
    noise that was put in."""
    poses, exact = poses_of(5, 40)
    xy = exact + np.random.default_rng(5).normal(0, NOISE, exact.shape)
    boards = [board(labels(), each, (640, 480)) for each in np.split(xy, 40)]
    found = calibrate(boards, SPACING, model="pinhole", flat=True)
    by_noise = np.sqrt(np.diag(solved(poses, exact, 5).found.cov))
    assert np.sqrt(np.diag(found.cov)) == pytest.approx(by_noise, rel=0.2)


def test_the_spread_of_the_parameters_is_the_stated_one():
    """A standard deviation from 60 runs is good to 1 / √120 = 9 %."""
    values = np.array([r.found.camera.parameters for r in runs()])
    stated = np.sqrt(np.mean([r.found.std**2 for r in runs()], axis=0))
    assert values.std(axis=0, ddof=1) / stated == pytest.approx(np.ones(4), abs=0.28)
    assert np.abs(values.mean(axis=0) - PINHOLE.parameters).max() < (4 * stated / np.sqrt(RUNS)).max()


def test_the_covariance_is_that_of_parameters_and_the_boards_mean_motion():
    x = np.array([np.concatenate([r.found.camera.parameters - PINHOLE.parameters, r.motion]) for r in runs()])
    cov = np.mean([r.found.cov for r in runs()], axis=0)
    assert x.std(axis=0) / np.sqrt(np.diag(cov)) == pytest.approx(np.ones(10), abs=0.3)
    squares = np.einsum("ni,ni->n", x @ np.linalg.inv(cov), x)
    assert squares.mean() == pytest.approx(10, rel=0.2)


@pytest.mark.parametrize("distance", [np.inf, 0.5, 2.0])
def test_projection_uncertainty_is_the_spread_of_points_that_stand_still_beside_the_boards(distance):
    """Each run sees the boards moved a little: a point that is fixed to them goes along by their mean motion."""
    stated = np.sqrt(np.mean([projection_uncertainty(r.found, PIXELS, distance) ** 2 for r in runs()], axis=0))
    rays = unproject(PINHOLE, PIXELS)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    seen = []
    for r in runs():
        m = r.motion
        far = rays @ rotation(m[:3]).T
        seen.append(project(r.found.camera, far if np.isinf(distance) else distance * far + m[3:]))
    spread = np.sqrt(np.array(seen).var(axis=0, ddof=1).mean(axis=1))
    assert spread / stated == pytest.approx(np.ones(3), abs=0.28)


def test_uncertainty_falls_with_more_corners_and_grows_away_from_them():
    few = calibrate(random_boards(CAMERAS["brown"], 1, 8)[0], SPACING, model="brown")
    many = calibrate(random_boards(CAMERAS["brown"], 1, 16)[0], SPACING, model="brown")
    assert (projection_uncertainty(many, PIXELS) < projection_uncertainty(few, PIXELS)).all()
    middle, _, corner = projection_uncertainty(few, np.array([[320, 240], [30, 30], [639, 479]]))
    assert corner > 2 * middle


def test_deviations_scale_with_the_noise_and_not_with_the_spacing():
    many = 20  # the scatter of a few views is known roughly only
    loud = calibrate(random_boards(CAMERAS["brown"], 2, many, noise=0.4)[0], SPACING, model="brown")
    quiet = calibrate(random_boards(CAMERAS["brown"], 2, many, noise=0.1)[0], SPACING, model="brown")
    large = calibrate(random_boards(CAMERAS["brown"], 2, many, noise=0.1)[0], 10 * SPACING, model="brown")
    assert loud.std / quiet.std == pytest.approx(np.full(9, 4), rel=0.25)
    assert large.std == pytest.approx(quiet.std, rel=1e-3)
    at = projection_uncertainty(quiet, PIXELS, 1.0)
    assert projection_uncertainty(large, PIXELS, 10.0) == pytest.approx(at, rel=1e-3)


def test_no_ray_no_uncertainty_and_wrong_arguments():
    found = runs()[0].found
    far = projection_uncertainty(found, [[320, 240], [np.nan, 5]])
    assert np.isfinite(far[0])
    assert np.isnan(far[1])
    assert projection_uncertainty(found, [10.0, 20.0]).shape == (1,)
    for distance in (0, -1, np.nan):
        with pytest.raises(RcdnError, match="distance"):
            projection_uncertainty(found, PIXELS, distance)
    with pytest.raises(RcdnError, match="pixels"):
        projection_uncertainty(found, np.zeros((3, 3)))


def test_coverage_counts_used_corners_cell_by_cell():
    xy = np.array([[0.0, 0], [319, 0], [320, 0], [639, 479], [639, 479], [-0.4, 479.4]])
    used = np.array([True, True, True, True, False, True])
    view = BoardView("a", 0, labels((3, 2)), xy, np.ones(6), Pose(np.eye(4)), 0 * xy, used)
    left_out = BoardView("b", 0, labels((3, 2)), xy, np.ones(6), None, 0 * xy, used, reason="no")
    found = Calibration(PINHOLE, 0.03, (view, left_out), np.eye(10), 0.1, ())
    assert coverage(found, (2, 1)).tolist() == [[3, 2]]
    assert coverage(found, (2, 2)).tolist() == [[2, 1], [1, 1]]
    assert coverage(found, (4, 3)).shape == (3, 4)


def test_the_truth_lies_within_one_deviation_two_times_in_three():
    """40 sets of views, all parameters pooled."""
    off = []
    for seed in range(40):
        found = solved(*poses_of(seed + 100), seed).found
        off.append((found.camera.parameters - PINHOLE.parameters) / found.std)
    assert 0.58 < (np.abs(off) < 1).mean() < 0.78
    assert (np.abs(off) < 2).mean() > 0.90


@pytest.mark.parametrize("boards", BOARDS)
def test_trust_counts_runs_and_shares(boards):
    done = trust("pinhole", 3, seed=0, boards=boards)
    assert (done.model, done.boards, done.runs, done.failed) == ("pinhole", boards, 3, 0)
    assert 0.25 <= done.within <= done.within2 <= 1
    assert set(done.by_noise) == {0.1, 0.3, 1.0}
    assert np.mean(list(done.by_noise.values())) == pytest.approx(done.within)
    assert (done.focal + done.centre) / 2 == pytest.approx(done.within)  # a pinhole has no more
    assert np.isnan(done.lens)
    assert row(done)["lens"] is None


# ---- by the scatter of whole views


def linear_problem(seed, views=14, bend=0.0, copies=1):
    """(state at the least squares, corners, weight, arrow, scale) of whole boards under a Brown lens
    without robust steps."""
    paper = (lambda draw: np.column_stack([np.zeros((54, 2)), smooth_error(draw, bend)])) if bend else None
    boards, poses = random_boards(CAMERAS["brown"], seed, views, NOISE, whole=True, offsets=paper)
    xy = np.concatenate([b.xy for _ in range(copies) for b in boards])
    frame = np.repeat(np.arange(copies * views), 54)
    corners = Corners3(frame, 0 * frame, np.tile(labels() * SPACING, (copies * views, 1)), xy, np.zeros((len(xy), 0)))
    state = State.mono(CAMERAS["brown"], np.array(poses * copies))
    weight = np.full(len(xy), 1 / NOISE)
    done = solve(state, corners, weight)
    square = ((residuals(done.state, corners) / NOISE) ** 2).sum()
    return done.state, corners, weight, done.arrow, float(square / (2 * len(xy) - 6 * views * copies - 9))


def stated(problem, cluster=None):
    """(deviations by the scatter of views, by the noise of corners, inflation)."""
    state, corners, weight, arrow, scale = problem
    found = clustered(state, corners, weight, default_free(state), arrow, scale, cluster)
    return np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(scale * arrow.covariance)), found.inflation


def test_corners_that_err_by_themselves_have_the_deviations_of_their_noise():
    by_views, by_noise, inflation = stated(linear_problem(1, 40))
    assert by_views == pytest.approx(by_noise, rel=0.25)
    assert (by_views / by_noise).mean() == pytest.approx(1, abs=0.15)
    assert inflation < 1.3


def test_paper_that_bends_anew_in_every_view_raises_the_deviations():
    by_views, by_noise, inflation = stated(linear_problem(1, 40, bend=0.0005))
    assert (by_views[:4] > 1.3 * by_noise[:4]).all()
    assert inflation > 2


def test_the_scatter_is_that_of_cameras_with_one_view_left_out(monkeypatch):
    """The jackknife, solved anew without each view: its sum of squares is that of the first order."""
    monkeypatch.setattr(uncertainty, "STEADY", 0.0)
    monkeypatch.setattr(uncertainty, "LEAST_LEFT", 1e-4)
    problem = linear_problem(3, 16, bend=0.0003)
    state, corners, weight, *_ = problem
    others = [solve(state, corners, np.where(corners.frame == f, 0, weight)).state for f in range(16)]
    off = np.array([o.cameras[0].parameters - state.cameras[0].parameters for o in others])
    assert stated(problem)[0] == pytest.approx(np.sqrt((off**2).sum(axis=0)), rel=0.15)


def test_copies_of_a_view_in_one_cluster_tell_no_more_than_one():
    one, four = linear_problem(2, 16), linear_problem(2, 16, copies=4)
    once, together = stated(one)[0], stated(four, np.tile(np.arange(16), 4))[0]
    assert together == pytest.approx(once, rel=0.03)
    assert stated(four)[1] == pytest.approx(stated(one)[1] / 2, rel=0.05)  # by the noise of corners they would


def test_four_copies_of_every_picture_do_not_make_a_camera_better():
    boards, _ = random_boards(CAMERAS["brown"], 3, 14)
    once = calibrate(boards, SPACING, model="brown")
    again = calibrate(boards * 4, SPACING, model="brown")
    assert (again.std > 0.9 * once.std).all()
    assert (np.abs(again.camera.parameters - once.camera.parameters) < once.std).all()


def test_fewer_than_three_clusters_tell_no_scatter():
    problem = linear_problem(2, 6)
    by_views, by_noise, inflation = stated(problem, np.array([0, 0, 0, 1, 1, 1]))
    assert by_views == pytest.approx(by_noise)
    assert inflation == 1


def test_the_covariance_of_few_views_has_full_rank():
    """Six views of nine parameters: the sum over views alone would have six directions at most."""
    state, corners, weight, arrow, scale = linear_problem(4, 6)
    found = clustered(state, corners, weight, default_free(state), arrow, scale).covariance
    unit = np.sqrt(np.diag(found))
    assert np.linalg.eigvalsh(found / np.outer(unit, unit)).min() > 1e-5
    off = state.cameras[0].parameters - CAMERAS["brown"].parameters
    assert off @ np.linalg.solve(found, off) < 9 + 4 * np.sqrt(18)
