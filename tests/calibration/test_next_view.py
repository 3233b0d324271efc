"""The next picture: its information is that of the least squares, and it brings what is promised."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate, projection_uncertainty
from rcdn.calibration import next_view as module
from rcdn.calibration.added_view import Information, Prior, judged_points, share_known, variances, weight_of
from rcdn.calibration.board_points import plane_of
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.next_view import NEARER, next_view, sentence
from rcdn.calibration.solver import Normal
from rcdn.calibration.uncertainty import Clustered, covariance
from rcdn.geometry import project, transform
from rcdn.types import SQUARES, Calibration, Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, labels, random_boards, see

BROWN = CAMERAS["brown"]
NOISE = 0.2


def stated(camera, poses, extra=()):
    """A calibration without views whose covariance is that of whole boards at `poses`, each corner with NOISE px."""
    poses = np.array([*poses, *extra])
    frame = np.repeat(np.arange(len(poses)), 54)
    points = np.tile(labels() * SPACING, (len(poses), 1))
    corners = Corners3(frame, 0 * frame, points, np.zeros((len(frame), 2)), np.zeros((len(frame), 0)))
    state = State.mono(camera, poses)
    arrow = Normal.of(state, corners, np.full(len(frame), 1 / NOISE), default_free(state)).arrow()
    by_noise = Clustered(arrow.covariance, 1.0)
    return Calibration(camera, SPACING, (), covariance(arrow, np.arange(len(poses)), 1.0, by_noise), NOISE, ())


def whole_boards(camera, seed, many, spread=0.25):
    boards, poses = random_boards(camera, seed, many, noise=NOISE, whole=True, spread=spread)
    return boards, poses


@pytest.mark.parametrize("model", ["pinhole", "brown", "fisheye"])
def test_one_view_more_is_that_of_the_whole_least_squares(model):
    """The covariance of six views and the information of a seventh give the covariance of all seven,
    mean motion included."""
    camera = CAMERAS[model]
    _, poses = whole_boards(camera, 2, 7)
    prior = replace(Prior.of(stated(camera, poses[:6])), views=6)
    points = (labels() * SPACING) @ poses[6][:3, :2].T + poses[6][:3, 3]
    more = Information.of(camera, points[None], np.full((1, 54), 1 / NOISE))
    both = stated(camera, poses[:6], poses[6:])
    pixels, by_camera, by_motion = judged_points(both.camera)
    found = np.sqrt(variances(prior, more, by_camera, by_motion)[0])
    assert found == pytest.approx(projection_uncertainty(both, pixels), rel=1e-4)


def test_a_parameter_that_is_fixed_stays_so():
    calibration = stated(BROWN, whole_boards(BROWN, 2, 6)[1])
    cov = np.array(calibration.cov)
    cov[4], cov[:, 4] = 0, 0
    prior = Prior.of(replace(calibration, cov=cov))
    assert prior.root.shape == (9, 8)
    assert prior.root[4] == pytest.approx(0)
    assert prior.root @ prior.root.T == pytest.approx(cov[:9, :9], rel=1e-6, abs=1e-12)


@pytest.fixture(scope="module")
def middling():
    """Boards in the middle of the frame only."""
    boards, _ = random_boards(BROWN, 7, 30, noise=NOISE, whole=True, spread=0.12)
    return boards, calibrate(boards, SPACING, model="brown", flat=True)


def test_the_picture_brings_what_is_promised(middling):
    """The board is held there, and the camera calibrated again: the worst uncertainty falls about as said, and much
    more than for one picture more in the middle."""
    boards, calibration = middling
    found = next_view(calibration)
    assert found.after < 0.5 * found.before
    assert found.worth_saying

    def worst(T):
        ij, xy = see(BROWN, T)
        xy = xy + np.random.default_rng(1).normal(0, NOISE, xy.shape)
        extra = board(ij - ij.min(axis=0), xy, BROWN.image_size, np.full(len(xy), NOISE))
        again = calibrate([*boards, extra], SPACING, model="brown", flat=True)
        return float(np.nanmax(projection_uncertainty(again, judged_points(calibration.camera)[0])))

    held = worst(found.pose.T_cam_board)
    # a view that alone tells of a corner of the frame is trusted less than its information says: nothing confirms it
    assert 0.45 * found.after < held < 2.2 * found.after
    assert held < 0.6 * worst(calibration.views[0].pose.T_cam_board)


def test_residuals_that_err_together_promise_less(middling):
    """With nine times the covariance of what corners alone say, a view tells a ninth."""
    _, calibration = middling
    doubted = replace(calibration, cov=9 * calibration.cov)
    plain, careful = next_view(calibration), next_view(doubted)
    ratio = share_known(doubted, Prior.of(doubted)) / share_known(calibration, Prior.of(calibration))
    assert ratio == pytest.approx(1 / 9, rel=1e-3)
    assert careful.before == pytest.approx(3 * plain.before)
    assert careful.after == pytest.approx(3 * plain.after, rel=1e-3)


def test_a_view_of_the_calibration_tells_about_its_share(middling):
    """Corners err independently here: the stated covariance is about that of the information;
    that by ten views is a little on the safe side."""
    _, calibration = middling
    assert share_known(calibration, Prior.of(calibration)) == pytest.approx(0.9, abs=0.2)
    assert weight_of(calibration) == pytest.approx(1 / NOISE, rel=0.3)
    assert plane_of(calibration) == SQUARES


@pytest.mark.parametrize("model", CAMERAS)
def test_the_board_is_in_the_frame_and_leans_as_said(model):
    camera = CAMERAS[model]
    calibration = calibrate(random_boards(camera, 4, 6, spread=0.3)[0], SPACING, model=model)
    found = next_view(calibration)
    assert sorted(found.size) == sorted(SIZE)
    xy = project(
        calibration.camera, transform(found.pose, np.column_stack([labels(found.size) * SPACING, np.zeros(54)]))
    )
    inside = ((xy > 0) & (xy < np.array(camera.image_size) - 1)).all(axis=1)
    assert inside.mean() > 0.45
    assert found.inside >= 0.5
    low, high = np.quantile([np.linalg.norm(v.pose.t) for v in calibration.used_views], [0, 1])
    assert low - 0.3 < found.distance < high + 0.3
    assert np.isfinite(found.outline).all()
    text = sentence(found, camera.image_size)
    assert f"{found.distance:.2g} m away" in text
    assert next_view(calibration).pose.T_cam_board == pytest.approx(found.pose.T_cam_board)


def test_the_side_that_is_named_is_nearer_and_where_it_says():
    camera = Camera([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]], [], (640, 480), "pinhole")
    calibration = calibrate(random_boards(camera, 4, 5)[0], SPACING, model="pinhole")
    every = module.candidates(calibration.camera, SIZE, SQUARES, calibration.spacing, np.array([0.5]))
    half = np.array([4, 2.5]) * SPACING
    for T, middle, tilt, side in zip(every.T, every.middle, every.tilt, every.side, strict=True):
        if tilt and np.hypot(*(middle - 319.5)) < 100:
            # a point of the board towards the named side is nearer, and seen on that side
            angle = np.radians(45 * side)
            towards = half + 0.05 * np.array([np.cos(angle), np.sin(angle)])
            point = T[:3, :2] @ towards + T[:3, 3]
            centre = T[:3, :2] @ half + T[:3, 3]
            assert np.linalg.norm(point) < np.linalg.norm(centre) - 0.02
            shift = project(camera, point) - project(camera, centre)
            assert shift @ [np.cos(angle), np.sin(angle)] > 0
    assert NEARER[0] == "right edge"
    assert NEARER[2] == "lower edge"


def test_without_poses_there_is_no_next_view(middling):
    _, calibration = middling
    blank = tuple(replace(v, pose=None) for v in calibration.views)
    assert next_view(replace(calibration, views=blank)) is None
    assert next_view(replace(calibration, views=())) is None
    assert next_view(replace(calibration, cov=np.nan * calibration.cov)) is None
