"""The least squares: the arrow against the dense inverse, and the solution against SciPy's and OpenCV's."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from rcdn.calibration import arrow, solver
from rcdn.calibration.arrow import RIDGE
from rcdn.calibration.bundle import Corners3, Prior, State, default_free, residuals
from rcdn.calibration.solver import SCALE, Linear, Normal, solve
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards


def mono(model, seed=0, views=8, noise=0.2, whole=True):
    """A start near the truth, and the corners of random boards."""
    boards, poses = random_boards(CAMERAS[model], seed, views, noise, whole=whole)
    lengths = [len(b) for b in boards]
    ij, xy = np.concatenate([b.ij for b in boards]), np.concatenate([b.xy for b in boards])
    frame = np.repeat(np.arange(views), lengths)
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 2)))
    return State.mono(CAMERAS[model], np.array(poses)), corners


def fives(corners):
    return np.full(len(corners), 5.0)


# ---- the arrow


def system(rng, frames=3, shared=5, n=40):
    """(Jacobians in the frames, in what is shared, frame numbers, dense normal matrix without prior)."""
    frame = np.repeat(np.arange(frames), n)
    a, b = rng.normal(size=(frames * n, 2, 6)), rng.normal(size=(frames * n, 2, shared))
    dense = np.zeros((frames * n, 2, 6 * frames + shared))
    for k, f in enumerate(frame):
        dense[k, :, 6 * f : 6 * f + 6] = a[k]
    dense[:, :, 6 * frames :] = b
    flat = dense.reshape(2 * frames * n, -1)
    return a, b, frame, flat.T @ flat


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_the_arrow_is_the_inverse_of_the_normal_matrix(damping):
    rng = np.random.default_rng(0)
    a, b, frame, normal = system(rng)
    root = rng.normal(size=(5, 5))
    precision = root @ root.T
    normal[18:, 18:] += precision
    normal += damping * np.diag(np.diag(normal))
    found = Linear(np.zeros((len(a), 2)), a, b, frame, 3, precision, np.zeros(5)).normal.arrow(damping)
    inverse = np.linalg.inv(normal)
    assert found.covariance == pytest.approx(inverse[18:, 18:], rel=1e-9, abs=1e-12)
    columns = [
        np.concatenate([m.ravel(), s]) for m, s in (found.solve(e[:18].reshape(3, 6), e[18:]) for e in np.eye(23))
    ]
    assert np.stack(columns, axis=1) == pytest.approx(inverse, rel=1e-9, abs=1e-12)
    # the blocks are a factor of it
    factor = np.zeros((23, 23))
    for f in range(3):
        factor[6 * f : 6 * f + 6, 6 * f : 6 * f + 6] = found.own[f]
        factor[6 * f : 6 * f + 6, 18:] = -found.reach[f] @ found.rim
    factor[18:, 18:] = found.rim
    assert factor @ factor.T == pytest.approx(inverse, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("least", [1e-3, 1e-9, 1e-11, 0.0, -1e-12])
def test_eigenvalues_below_the_ridge_count_as_the_ridge(least):
    """Whether by Cholesky's factor or, where it says nothing of small eigenvalues, by these."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(6, 6)))[0]
    values = np.array([least, 0.2, 0.5, 1, 1.5, 2])
    U = arrow._inverse_root(((Q * values) @ Q.T)[None])[0]
    assert np.abs(np.tril(U, -1)).max() == 0
    along = Q.T @ U @ U.T @ Q  # the inverse in the coordinates of the eigenvectors
    assert np.diag(along) == pytest.approx(1 / np.maximum(values, RIDGE), rel=1e-4)


@pytest.mark.parametrize("many", [1, 6, 32, 33])
def test_factors_of_inverses_whatever_their_size(many):
    """By the kernel and, of more rows than it takes, by LAPACK; asymmetric by rounding, of very different units, with a
    parameter that no corner depends on."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, many + 3, many)) * 10.0 ** rng.uniform(-6, 6, (3, 1, many))
    blocks = root.transpose(0, 2, 1) @ root
    inverse = np.linalg.inv(blocks)
    unit = np.sqrt(np.einsum("fii->fi", inverse))
    U = arrow._inverse_factor(blocks * (1 + 1e-15 * rng.normal(size=blocks.shape)))
    assert np.tril(U, -1).any() == 0
    assert U @ U.transpose(0, 2, 1) / unit[:, :, None] / unit[:, None] == pytest.approx(
        inverse / unit[:, :, None] / unit[:, None], abs=1e-6
    )
    blocks[1, -1], blocks[1, :, -1] = 0, 0
    U = arrow._inverse_factor(blocks)
    assert not U[1, -1].any()
    assert not U[1, :, -1].any()
    own = blocks[1, :-1, :-1]
    assert U[1, :-1, :-1].T @ own @ U[1, :-1, :-1] == pytest.approx(np.eye(many - 1), abs=1e-6)


@pytest.mark.parametrize("many", [2, 6, 33])
@pytest.mark.parametrize("least", [1e-7, 1e-11, -1e-12])
def test_factors_have_the_ridge_where_a_block_is_singular(many, least):
    """Of one block, though another is regular."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(many, many)))[0]
    values = np.linspace(0.5, 1, many)
    values[0] = least
    block = (Q * values) @ Q.T
    _, U = arrow._inverse_factor(np.stack([np.eye(many), block]))
    unit = np.sqrt(np.diag(block))
    vectors = np.linalg.eigh(block / np.outer(unit, unit))[1]
    along = vectors.T @ (unit[:, None] * U @ U.T * unit) @ vectors
    at_unit = np.linalg.eigvalsh(block / np.outer(unit, unit))
    assert np.diag(along) == pytest.approx(1 / np.maximum(at_unit, RIDGE), rel=1e-3)


@pytest.mark.parametrize("many", [6, 33])
def test_rounding_that_elimination_leaves_is_no_information(many):
    """A diagonal below 1e-13 of what it was counts as that much."""
    (U,) = arrow._inverse_factor(np.diag(np.full(many, 1e-20))[None], np.ones(many))
    assert np.diag(U) == pytest.approx(np.full(many, 1e10))
    (U,) = arrow._inverse_factor(np.diag(np.full(many, 1e-14))[None], np.full(many, 0.5))
    assert np.diag(U) == pytest.approx(np.full(many, 1e7))


def test_factors_of_no_number_are_none():
    broken = np.eye(6)
    broken[1] = broken[:, 1] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        arrow._inverse_factor(broken[None])


@pytest.mark.parametrize("away", [[np.nan, np.nan], [1e9, 0], [0, -1e9]])
def test_the_cost_is_a_sum_over_corners_that_count(away):
    state, corners = mono("brown", views=3)
    xy, weight = corners.xy.copy(), np.linspace(1, 6, len(corners))
    xy[4] += away
    xy[7] = np.nan
    weight[7] = 0
    far = replace(corners, xy=xy)
    z = residuals(state, far) * weight[:, None]
    z[4], z[7] = solver.BEHIND, 0  # what a camera can't see, and what doesn't count
    for loss, each in (("linear", z**2), ("soft_l1", 2 * SCALE**2 * (np.sqrt(1 + (z / SCALE) ** 2) - 1))):
        expected = each.sum() + state.beforehand.cost(state.values)
        assert solver._cost(state, far, weight, loss) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("curvature", "length"), [(1.0, 0.5), (0.5, 1.0), (0.45, 1.0), (0.25, 2.0), (-1.0, 1.0), (9.0, 1.0)]
)
def test_a_step_ends_where_the_parabola_along_it_does(curvature, length):
    """Unless that is near, or far from what is known."""
    assert solver._on_parabola(lambda t: (t, 7 - t + curvature * t**2), 7.0, 1.0)[0] == pytest.approx(length)


@pytest.mark.parametrize("many", [8, solver.MANY, solver.MANY + 7])
def test_normal_equations_are_products_of_the_dense_jacobian(many):
    """With frames in any order, one without corners, and parameters that move corners along one axis only."""
    rng = np.random.default_rng(2)
    by_frame, shared, frame, _ = system(rng, shared=many, n=70)
    for axis in range(2):
        shared[:, axis, 2 + axis :: 2] = 0
    flat = shared.reshape(-1, many)
    gaps = rng.normal(size=(len(frame), 2))
    order = rng.permutation(len(frame))
    found = Linear(
        gaps[order], by_frame[order], shared[order], frame[order], 4, np.zeros((many, many)), np.zeros(many)
    ).normal
    assert found.whole == pytest.approx(flat.T @ flat, abs=1e-9)
    assert found.gradient[1] == pytest.approx(flat.T @ gaps.ravel(), abs=1e-9)
    for f in range(3):
        mine = frame == f
        own, other = by_frame[mine].reshape(-1, 6), shared[mine].reshape(-1, many)
        assert found.blocks[f] == pytest.approx(np.hstack([own.T @ own, own.T @ other]), abs=1e-9)
        assert found.gradient[0][f] == pytest.approx(own.T @ gaps[mine].ravel(), abs=1e-9)
    assert not found.blocks[3].any()
    assert not found.gradient[0][3].any()


def test_the_whole_step_stands_where_the_parabola_is_wrong():
    assert solver._on_parabola(lambda t: (t, 6.9 if t == 1 else 7.2), 7.0, 1.0) == (1.0, 6.9)


def test_the_gradient_is_that_of_half_the_cost():
    """Its zero is where the sum of squares and the prior's are least."""
    state, corners = mono("brown", views=4)
    state = replace(state, prior=Prior(np.zeros(9), np.diag(np.full(9, 0.3))))
    weight = np.linspace(1, 6, len(corners))

    def half(motions, shared):
        other = state.moved(motions, shared)
        gaps = residuals(other, corners) * weight[:, None]
        return ((gaps**2).sum() + state.beforehand.cost(other.values)) / 2

    by_frame, shared = Normal.of(state, corners, weight, default_free(state)).gradient
    for k in range(6):
        d = np.zeros((4, 6))
        d[1, k] = 1e-7
        assert by_frame[1, k] == pytest.approx((half(-d, np.zeros(9)) - half(d, np.zeros(9))) / 2e-7, rel=1e-4, abs=0.1)
    for k in range(9):
        d = np.zeros(9)
        d[k] = 1e-6
        still = np.zeros((4, 6))
        assert shared[k] == pytest.approx((half(still, -d) - half(still, d)) / 2e-6, rel=1e-4, abs=0.1)


# ---- against SciPy


def by_scipy(state, corners, weight, free, loss="linear"):
    """SciPy's least squares of the same residuals, its own numerical slopes;
    the prior as rows of its Cholesky factor."""
    prior = state.beforehand
    root = np.linalg.cholesky(prior.precision + 1e-30 * np.eye(len(prior.mean)))
    frames, many = len(state.poses), int(free.sum())

    def state_at(x):
        shared = np.zeros(len(free))
        shared[free] = x[6 * frames :]
        return state.moved(x[: 6 * frames].reshape(frames, 6), shared)

    def rows(x):
        other = state_at(x)
        gaps = (residuals(other, corners) * weight[:, None]).ravel()
        return np.concatenate([gaps, root.T @ (other.values - prior.mean)])

    found = least_squares(
        rows, np.zeros(6 * frames + many), x_scale="jac", loss=loss, f_scale=SCALE, xtol=1e-12, ftol=1e-12
    )
    return state_at(found.x)


@pytest.mark.parametrize("model", ["pinhole", "brown", "fisheye"])
def test_the_solution_is_that_of_scipy(model):
    state, corners = mono(model, seed=1, views=3)
    free = default_free(state)
    done = solve(state, corners, fives(corners), free)
    theirs = by_scipy(state, corners, fives(corners), free).cameras[0].parameters
    off = np.abs(done.state.cameras[0].parameters - theirs) / np.sqrt(np.diag(done.arrow.covariance))
    assert off.max() < 1e-3


def test_the_soft_loss_is_that_of_scipy():
    """With linear penalties from two deviations on, on corners of which some are wrong."""
    state, corners = mono("pinhole", seed=2, views=3)
    xy = corners.xy.copy()
    xy[::15] += 7
    corners, free = replace(corners, xy=xy), default_free(state)
    ours = solve(state, corners, fives(corners), free, "soft_l1", iterations=200)
    theirs = by_scipy(state, corners, fives(corners), free, "soft_l1").cameras[0].parameters
    off = np.abs(ours.state.cameras[0].parameters - theirs) / np.sqrt(np.diag(ours.arrow.covariance))
    assert off.max() < 0.02


def test_a_prior_is_weighed_against_the_corners_as_scipy_does():
    state, corners = mono("brown", seed=3, views=3)
    spread = np.array([3.0, 3, 3, 3, 0.01, 0.01, 1e-4, 1e-4, 0.01])
    prior = Prior(state.values + spread * np.linspace(-2, 2, 9), np.diag(spread**-2.0))
    state, free = replace(state, prior=prior), default_free(state)
    done = solve(state, corners, fives(corners), free)
    theirs = by_scipy(state, corners, fives(corners), free).cameras[0].parameters
    off = np.abs(done.state.cameras[0].parameters - theirs) / np.sqrt(np.diag(done.arrow.covariance))
    assert off.max() < 1e-3
    assert (np.sqrt(np.diag(done.arrow.covariance)) < spread).all()


def test_a_narrow_prior_wins_and_a_wide_one_does_nothing():
    state, corners = mono("brown", seed=3, views=4)
    many = len(state.values)
    state = replace(state, prior=Prior(np.zeros(many), np.zeros((many, many))))
    alone = solve(state, corners, fives(corners))
    std = np.sqrt(np.diag(alone.arrow.covariance))
    mean = state.values + 5 * std
    at = {}
    for share in (1e-4, 1e4):
        prior = Prior(mean, np.diag((share * std) ** -2.0))
        at[share] = solve(replace(state, prior=prior), corners, fives(corners))
    assert np.abs(at[1e-4].state.cameras[0].parameters - mean).max() < 1e-2 * std.max()
    assert np.abs((at[1e4].state.cameras[0].parameters - alone.state.cameras[0].parameters) / std).max() < 1e-3
    assert np.sqrt(np.diag(at[1e-4].arrow.covariance)) == pytest.approx(1e-4 * std, rel=1e-3)


def test_fixed_parameters_stay_and_the_rest_is_least_squares_without_them():
    state, corners = mono("brown", seed=4, views=4)
    free = default_free(state)
    free[[4, 8]] = False
    done = solve(state, corners, fives(corners), free)
    assert done.state.cameras[0].parameters[[4, 8]] == pytest.approx(state.cameras[0].parameters[[4, 8]], abs=0)
    assert done.arrow.covariance.shape == (7, 7)
    theirs = by_scipy(state, corners, fives(corners), free).cameras[0].parameters
    off = np.abs(done.state.cameras[0].parameters - theirs)[free] / np.sqrt(np.diag(done.arrow.covariance))
    assert off.max() < 1e-3


# ---- what does not pull


def test_what_no_corner_tells_of_does_not_move():
    state, corners = mono("brown", views=4)
    state = replace(state, shape=np.zeros((2, 3)))
    shaped = default_free(state, shape=True)  # the functions are zero at all corners, so that the shape changes nothing
    assert (solve(state, corners, fives(corners), shaped).state.shape == 0).all()


def test_a_frame_without_corners_keeps_its_pose():
    state, corners = mono("brown", views=4)
    some = corners.take(corners.frame != 2)
    done = solve(state, some, fives(some)).state
    assert np.array_equal(done.poses[2], state.poses[2])
    assert not np.array_equal(done.poses[1], state.poses[1])


def test_corners_without_weight_do_not_pull():
    state, corners = mono("brown", views=5)
    xy = corners.xy.copy()
    xy[::7] += 100
    weight = np.where(np.arange(len(xy)) % 7, 5.0, 0.0)
    a, b = (solve(state, c, weight).state for c in (corners, replace(corners, xy=xy)))
    assert b.cameras[0].parameters == pytest.approx(a.cameras[0].parameters, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("far", [np.nan, 1e12])
def test_corners_that_no_camera_can_see_do_not_pull(far):
    """Their derivatives are finite, too, where it is the residual that is out of bounds."""
    state, corners = mono("brown", views=4)
    xy, weight = corners.xy.copy(), fives(corners)
    xy[::7, 0], weight[::7] = far, 0.0
    a = Normal.of(state, replace(corners, xy=xy), fives(corners), default_free(state))
    b = Normal.of(state, corners, weight, default_free(state))
    assert np.array_equal(a.blocks, b.blocks)
    assert np.array_equal(a.whole, b.whole)
    assert all(np.array_equal(x, y) for x, y in zip(a.gradient, b.gradient, strict=True))


# ---- against OpenCV

FLAGS = {"pinhole": 0, "brown": 0, "rational": cv2.CALIB_RATIONAL_MODEL}
NO_LENS = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational"])
def test_the_solution_is_that_of_opencv(model):
    state, corners = mono(model, seed=1)
    done = solve(state, corners, fives(corners))
    gaps = residuals(done.state, corners)
    rms = np.sqrt((gaps**2).sum(axis=1).mean())
    board = np.column_stack([corners.board, np.zeros(len(corners))]).astype(np.float32)
    views = range(len(state.poses))
    flags = FLAGS[model] | (NO_LENS if model == "pinhole" else 0)
    theirs = cv2.calibrateCameraExtended(
        [board[corners.frame == f] for f in views],
        [corners.xy[corners.frame == f].astype(np.float32) for f in views],
        (640, 480), state.cameras[0].K.copy(), state.cameras[0].distortion.copy(),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-15),
    )  # fmt: skip
    assert rms < theirs[0] + 1e-3
    if model == "rational":
        return  # its numbers are held together by a prior, which OpenCV doesn't have
    assert rms == pytest.approx(theirs[0], abs=1e-4)
    K, std = theirs[1], np.sqrt(np.diag(done.arrow.covariance))
    theirs_all = np.concatenate([K[[0, 1, 0, 1], [0, 1, 2, 2]], np.ravel(theirs[2])[: len(std) - 4]])
    off = np.abs(done.state.cameras[0].parameters - theirs_all) / std
    assert off.max() < 0.05


# ---- rough starts


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
    spoilt = replace(corners, xy=xy)
    off = {}
    for loss in ("linear", "soft_l1"):
        done = solve(state, spoilt, fives(corners), loss=loss).state
        off[loss] = np.abs(done.cameras[0].parameters - state.cameras[0].parameters)[:4].max()
    assert off["soft_l1"] < 3 < off["linear"]


def test_blind_corners_are_expensive_but_do_not_stop_the_solver():
    """A start that puts a board behind the camera: NaN residuals, no crash."""
    state, corners = mono("brown", views=4)
    poses = state.poses.copy()
    poses[0, 2, 3] = -0.5
    done = solve(State.mono(Camera(CAMERAS["brown"].K, np.zeros(5), (640, 480)), poses), corners, np.ones(len(corners)))
    assert np.isfinite(done.state.cameras[0].parameters).all()
    assert np.isnan(residuals(done.state, corners)[corners.frame == 0]).any()


def test_normal_equations_in_parts_are_those_of_the_whole(monkeypatch):
    """A problem too large to be held at once is summed in parts of a few corners."""
    from rcdn.calibration.bundle import Corners3, State, default_free
    from rcdn_lab.camera_scenes import CAMERAS, SPACING, labels, random_boards

    camera = CAMERAS["brown"]
    boards, poses = random_boards(camera, 3, views=4, whole=True)
    frame = np.repeat(np.arange(4), len(labels()))
    xy, ij = np.concatenate([b.xy for b in boards]), np.concatenate([b.ij for b in boards])
    corners = Corners3(frame, np.zeros(len(xy), int), ij * SPACING, xy, np.zeros((len(xy), 0)))
    state = State.mono(camera, np.array(poses))
    free = default_free(state)
    weight = np.random.default_rng(0).uniform(0, 2, len(xy))
    whole = solver.Normal.of(state, corners, weight, free, "soft_l1")
    monkeypatch.setattr(solver, "AT_ONCE", 2 * sum(state.counts) * 17)
    parts = solver.Normal.of(state, corners, weight, free, "soft_l1")
    assert parts.blocks == pytest.approx(whole.blocks, rel=1e-9, abs=1e-6)
    assert parts.whole == pytest.approx(whole.whole, rel=1e-9, abs=1e-6)
    for mine, theirs in zip(parts.gradient, whole.gradient, strict=True):
        assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-6)
