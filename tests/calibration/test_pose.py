"""Poses of one board: every lens, honest covariances, outliers, and both answers where a picture allows two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate, calibrate_rig, calibrate_stereo, estimate_pose, estimate_rig_pose
from rcdn.errors import CalibrationError, ConfigError, RcdnError
from rcdn.geometry import rotation
from rcdn.geometry.order import turn_labels
from rcdn.geometry.part import quarter_turns
from rcdn.types import BoardShape, Camera, Pose, Rig
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards, random_pose, see
from rcdn_lab.real_boards import uneven_board

BROWN = CAMERAS["brown"]
FISHEYE = Camera(
    np.array([[150.0, 0, 322], [0, 149, 241], [0, 0, 1]]), [0.02, -0.005, 0.001, -0.0002], (640, 480), "fisheye"
)


def error_of(T, truth):
    """(6,) the small motion that leads from the truth to `T`."""
    D = T[:3, :3] @ truth[:3, :3].T
    return np.concatenate([Rotation.from_matrix(D).as_rotvec(), T[:3, 3] - D @ truth[:3, 3]])


def views(camera, seed, many, noise=0.2, size=(9, 6), sigma=True, **pose):
    """(board, true pose) of whole boards."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < many:
        T = random_pose(rng, size=size, **pose)
        ij, xy = see(camera, T, size)
        if len(ij) == size[0] * size[1]:
            xy = xy + rng.normal(0, noise, xy.shape)
            out.append((board(ij, xy, camera.image_size, np.full(len(xy), noise) if sigma else None), T))
    return out


@pytest.mark.parametrize("sigma", [True, False], ids=["sigma", "no sigma"])
@pytest.mark.parametrize("model", CAMERAS)
def test_the_covariance_holds_the_error(model, sigma):
    """Squares of error by covariance are a chi-square of 6 degrees: their mean over 12 poses is 6 ± 1."""
    squares = []
    for b, T in views(CAMERAS[model], 1, 12, sigma=sigma):
        found = estimate_pose(b, CAMERAS[model], SPACING)
        off = error_of(found.T_cam_board, T)
        squares.append(off @ np.linalg.solve(found.cov, off))
        assert not found.ambiguous
        assert found.std[:3] == pytest.approx(np.sqrt(np.diag(found.cov))[:3])
        assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.35)
    assert 3 < np.mean(squares) < 9.5
    assert max(squares) < 30


def test_deviations_of_the_position_are_those_of_the_position_itself():
    """Of `t`, not of the motion that `cov` is of: that one turns the board about the camera's centre first."""
    (seen, T), rng = views(BROWN, 3, 1)[0], np.random.default_rng(4)
    off, told = [], []
    for _ in range(100):
        xy = see(BROWN, T)[1] + rng.normal(0, 0.2, seen.xy.shape)
        found = estimate_pose(replace(seen, xy=xy), BROWN, SPACING)
        off.append(found.t - T[:3, 3])
        told.append(found.std[3:])
    assert np.sqrt(np.mean(np.square(off), axis=0)) / np.mean(told, axis=0) == pytest.approx(np.ones(3), abs=0.2)
    assert [found.std[name] for name in ("tx", "ty", "tz")] == pytest.approx(told[-1])


def test_a_camera_of_another_picture_size_is_refused():
    ((seen, _),) = views(BROWN, 2, 1)
    other = replace(BROWN, image_size=(2 * BROWN.image_size[0], 2 * BROWN.image_size[1]))
    with pytest.raises(ConfigError, match="camera: its pictures have 1280×960 px, and the board's has 640×480"):
        estimate_pose(seen, other, SPACING)


def test_beside_and_behind_a_fisheye():
    rng = np.random.default_rng(0)
    for off in (60, 85, 95, 105):
        a = np.radians(off)
        sight = np.array([np.sin(a), 0, np.cos(a)])
        R = rotation(np.array([0, a, 0])) @ rotation(np.array([0.3, -0.2, 0.4]))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, 0.3 * sight - R @ [0.12, 0.075, 0]
        ij, xy = see(FISHEYE, T)
        found = estimate_pose(board(ij, xy + rng.normal(0, 0.1, xy.shape), (640, 480)), FISHEYE, SPACING)
        error = error_of(found.T_cam_board, T)
        assert error @ np.linalg.solve(found.cov, error) < 30
        assert np.linalg.norm(error[:3]) < 0.02


@pytest.mark.parametrize(("size", "distance"), [((4, 3), (1.5, 3)), ((9, 6), (4, 8))])
def test_far_boards_are_ambiguous_and_the_truth_is_one_of_both(size, distance):
    """A board of 10 to 50 px: of two poses the picture doesn't tell, and what is stated must hold."""
    ambiguous, wrong = 0, 0
    for b, T in views(BROWN, 2, 12, noise=0.3, size=size, spread=0.2, tilt=0.5, distance=distance):
        found = estimate_pose(b, BROWN, SPACING)
        both = [found.T_cam_board] + ([found.other.T_cam_board] if found.other is not None else [])
        angles = [np.linalg.norm(error_of(each, T)[:3]) for each in both]
        ambiguous += found.ambiguous
        wrong += angles[0] > 5 * found.std[:3].max() and not found.ambiguous
        if found.ambiguous:
            # a board that faces the camera is found tilted, one way or the other: the truth lies between both
            between = np.linalg.norm(error_of(both[0], both[1])[:3])
            assert min(angles) < max(5 * found.std[:3].max(), 0.75 * between)
    assert ambiguous >= 3
    assert wrong == 0


def test_a_near_tilted_board_is_not_ambiguous():
    for b, _ in views(BROWN, 3, 6, tilt=0.8, distance=(0.3, 0.5)):
        assert not estimate_pose(b, BROWN, SPACING).ambiguous


def test_outliers_are_left_out():
    rng = np.random.default_rng(4)
    for b, T in views(BROWN, 4, 6):
        xy = b.xy.copy()
        xy[rng.choice(54, 5, replace=False)] += rng.uniform(8, 30, (5, 2))
        found = estimate_pose(replace(b, xy=xy), BROWN, SPACING)
        off = error_of(found.T_cam_board, T)
        assert off @ np.linalg.solve(found.cov, off) < 30
        assert found.rms < 0.5
        assert (np.linalg.norm(found.residuals, axis=1) > 5).sum() == 5


def test_squares_without_a_spacing_and_parts_from_their_own_corner():
    b, T = views(BROWN, 5, 1, noise=0.0)[0]
    found = estimate_pose(b, BROWN)
    assert found.t == pytest.approx(T[:3, 3] / SPACING, abs=1e-6)
    keep = (b.ij >= [2, 1]).all(axis=1)
    part = board(b.ij[keep] - [2, 1], b.xy[keep], (640, 480))
    assert estimate_pose(part, BROWN, SPACING).t == pytest.approx(
        T[:3, :3] @ [2 * SPACING, SPACING, 0] + T[:3, 3], abs=1e-6
    )


def test_a_known_shape():
    """Uneven in the plane and out of it."""
    offsets = uneven_board(np.random.default_rng(0), 0.01, 0.0003, 0.0015)
    shape = BoardShape(offsets.reshape(6, 9, 3))
    for b, T in zip(*random_boards(BROWN, 3, 3, 0.1, whole=True, offsets=offsets), strict=True):
        real, flat = estimate_pose(b, BROWN, SPACING, shape=shape), estimate_pose(b, BROWN, SPACING)
        assert real.rms < 0.2 < flat.rms
        off = error_of(real.T_cam_board, T)
        assert off @ np.linalg.solve(real.cov, off) < 30


@pytest.mark.parametrize("size", [(9, 6), (6, 9), (8, 6), (7, 5)])
def test_a_shape_is_turned_to_a_board_of_the_transposed_size(size):
    """Given by the labels of `Board.grid_of`, it gives the pose and the residuals of one by the board's own labels."""
    columns, rows = size
    offsets = np.random.default_rng(1).normal(0, 0.002, (rows * columns, 3))
    (b,), (T,) = random_boards(BROWN, 4, 1, 0.0, whole=True, offsets=offsets, size=size)
    quarter = replace(b, xy=offsets[:, :2]).grid_of(size[::-1])  # where each displacement goes by a quarter turn
    plane = replace(b, xy=b.ij.astype(float)).grid_of(size[::-1])
    along, down = plane[0, 1] - plane[0, 0], plane[1, 0] - plane[0, 0]
    height = replace(b, xy=np.column_stack([offsets[:, 2]] * 2)).grid_of(size[::-1])[..., :1]
    shape = BoardShape(np.concatenate([quarter @ np.stack([along, down], axis=1), height], axis=2))
    assert shape.size == size[::-1]
    found = estimate_pose(b, BROWN, SPACING, shape=shape)
    assert found.rms < 1e-6
    assert found.T_cam_board == pytest.approx(T, abs=1e-8)
    own = estimate_pose(b, BROWN, SPACING, shape=BoardShape(offsets.reshape(rows, columns, 3)))
    assert found.T_cam_board == pytest.approx(own.T_cam_board, abs=1e-8)


def test_a_shape_is_turned_to_a_square_board_of_the_other_colours():
    """It is that of boards with a dark square inside (0, 0), as calibrations label those of an odd number of corners a
    side."""
    offsets = np.random.default_rng(1).normal(0, 0.002, (49, 3))
    (b,), _ = random_boards(BROWN, 4, 1, 0.0, whole=True, offsets=offsets, size=(7, 7))
    shape, b = BoardShape(offsets.reshape(7, 7, 3)), replace(b, orientation="ambiguous_180", origin_dark=True)
    bright = replace(b, ij=turn_labels(b.ij, (7, 7), -quarter_turns((7, 7))), origin_dark=False)
    dark, turned = (estimate_pose(each, BROWN, SPACING, shape=shape) for each in (b, bright))
    assert max(dark.rms, turned.rms) < 1e-6
    first = b.ij[(bright.ij == 0).all(axis=1)][0]  # of the corner (0, 0) of `bright`
    assert turned.t == pytest.approx(dark.R @ [*(first * SPACING), 0] + dark.t, abs=1e-8)
    for name, boards in {"alone": {"a": bright}, "both": {"a": bright, "b": b}}.items():
        pair = Rig(tuple(boards), (BROWN,) * len(boards), (Pose(np.eye(4)),) * len(boards))
        found = estimate_rig_pose(boards, pair, SPACING, shape=shape)
        assert found.rms < 1e-6, name
        assert found.residuals.keys() == boards.keys()


def test_the_shape_of_a_calibration_with_a_transposed_size_serves_boards_by_their_own_labels():
    offsets = uneven_board(np.random.default_rng(0), 0.01, 0.0003, 0.0015)
    boards, _ = random_boards(BROWN, 3, 10, 0.1, whole=True, offsets=offsets)
    usual, turned = (calibrate(boards, SPACING, model="brown", size=size) for size in (None, (6, 9)))
    assert (usual.shape.size, turned.shape.size) == ((9, 6), (6, 9))
    a, b = (estimate_pose(boards[0], BROWN, SPACING, shape=c.shape) for c in (usual, turned))
    assert a.T_cam_board == pytest.approx(b.T_cam_board, abs=1e-5)
    assert max(a.rms, b.rms) < 0.2 < estimate_pose(boards[0], BROWN, SPACING).rms
    view = turned.views[0]
    first = boards[0].ij[(view.ij == 0).all(axis=1)][0]  # the corner (0, 0) of the calibration, by the board's labels
    assert first.any()
    assert view.pose.t == pytest.approx(b.R @ [*(first * SPACING), 0] + b.t, abs=0.002)


def test_a_shape_is_that_of_whole_boards():
    b = views(BROWN, 6, 1)[0][0]
    with pytest.raises(ConfigError, match="shape: it is that of whole boards of 7×5 corners"):
        estimate_pose(b, BROWN, SPACING, shape=BoardShape(np.zeros((5, 7, 3))))


def test_a_shape_needs_the_spacing_of_its_calibration():
    """Its offsets are in metres; one metre may be a square's side, if it is said."""
    b, shape = views(BROWN, 6, 1)[0][0], BoardShape(np.zeros((6, 9, 3)))
    for call in (estimate_pose, lambda one, camera, **more: estimate_rig_pose({"a": one}, of_one(camera), **more)):
        with pytest.raises(ConfigError, match=r"spacing must be given with a shape.* spacing=calibration\.spacing"):
            call(b, BROWN, shape=shape)
        for spacing in (1, 1.0, SPACING):
            assert call(b, BROWN, spacing=spacing, shape=shape).rms < 1


def of_one(camera):
    return Rig(("a",), (camera,), (Pose(np.eye(4)),))


def test_four_corners_and_fewer():
    b, T = views(BROWN, 6, 1, noise=0.0)[0]
    pick = lambda rows: board(b.ij[rows], b.xy[rows], (640, 480))  # noqa: E731
    assert estimate_pose(pick([0, 1, 9, 10]), BROWN, SPACING).T_cam_board == pytest.approx(T, abs=1e-5)
    for rows in ([0, 1, 9], [], list(range(9))):
        with pytest.raises(CalibrationError, match="4 corners, not all in one line"):
            estimate_pose(pick(rows), BROWN, SPACING)


def test_corners_that_the_camera_can_not_see():
    b, T = views(BROWN, 6, 1, noise=0.0)[0]
    xy = b.xy.copy()
    xy[3] = 1e5
    assert estimate_pose(replace(b, xy=xy), BROWN, SPACING).T_cam_board == pytest.approx(T, abs=1e-6)
    with pytest.raises(CalibrationError, match="has 0 that this camera can see"):
        estimate_pose(replace(b, xy=b.xy + 1e5), BROWN, SPACING)


def test_corners_without_a_position_are_refused_by_all_alike():
    good = [b for b, _ in views(BROWN, 6, 4)]
    xy = good[0].xy.copy()
    xy[3] = np.nan
    bad = replace(good[0], xy=xy)
    rig = Rig(("a", "b"), (BROWN, BROWN), (Pose(np.eye(4)), Pose(np.eye(4))))
    calls = {
        "board": lambda: estimate_pose(bad, BROWN, SPACING),
        r"boards\['b'\]": lambda: estimate_rig_pose({"a": good[1], "b": bad}, rig, SPACING),
        r"boards\[1\]": lambda: calibrate([good[1], bad, *good[2:]], SPACING),
        r"right\[0\]": lambda: calibrate_stereo(good[1:], [bad, *good[2:]], SPACING),
        r"views\['b'\]\[2\]": lambda: calibrate_rig({"a": good[:3], "b": [*good[2:], bad]}, SPACING),
    }
    for name, call in calls.items():
        with pytest.raises(ConfigError, match=f"^{name}.xy must be finite; leave out corners that have no position"):
            call()


@pytest.mark.parametrize("spacing", [0, -1, np.nan])
def test_spacing_must_be_a_length(spacing):
    with pytest.raises(ConfigError, match="spacing"):
        estimate_pose(views(BROWN, 6, 1)[0][0], BROWN, spacing)


def test_division_is_refused():
    with pytest.raises(RcdnError, match="division"):
        estimate_pose(views(BROWN, 6, 1)[0][0], Camera(BROWN.K, [-0.1], (640, 480), "division"), SPACING)


@pytest.mark.parametrize("spoil", ["scrambled", "one pixel"])
def test_corners_that_no_pose_fits_are_an_error_or_a_bad_rms(spoil):
    b = views(BROWN, 6, 1)[0][0]
    xy = np.random.default_rng(0).permutation(b.xy) if spoil == "scrambled" else 0 * b.xy + 50
    with pytest.raises(CalibrationError, match="no pose fits"):
        estimate_pose(replace(b, xy=xy), BROWN, SPACING)


def test_a_skewed_camera_from_a_file():
    K = BROWN.K.copy()
    K[0, 1] = 30
    camera = replace(BROWN, K=K)
    for b, T in views(camera, 7, 3, noise=0.0):
        assert estimate_pose(b, camera, SPACING).T_cam_board == pytest.approx(T, abs=1e-6)
