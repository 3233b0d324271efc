"""Two cameras: known rigs, turned and partial boards, wrong pairs, mirrored pictures, rectified rows."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rcdn
from rcdn.calibration import calibrate_rig, calibrate_stereo
from rcdn.calibration.relative_pose import reversed_in_a_mirror, turn_labels
from rcdn.errors import CalibrationError, ConfigError, RcdnError
from rcdn.geometry import rotation, unproject
from rcdn.terminal.camera_text import swapped_hint
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, detected, random_pose, see

T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3] = rotation(np.array([0.02, -0.15, 0.03])), [-0.12, 0.004, 0.01]
PINHOLE, BROWN = CAMERAS["pinhole"], CAMERAS["brown"]


def pairs(left, right, seed=0, views=8, size=(9, 6), least=1.0, spread=0.35):
    """Boards whole to the left camera, and at least `least` of each to the right one."""
    rng, a, b = np.random.default_rng(seed), [], []
    while len(a) < views:
        T = random_pose(rng, spread, 0.7, (0.4, 0.8), size)
        seen = [see(left, T, size), see(right, T_RIGHT_LEFT @ T, size)]
        whole = size[0] * size[1]
        if len(seen[0][0]) < whole or len(seen[1][0]) < least * whole:
            continue
        for out, camera, (ij, xy) in zip((a, b), (left, right), seen, strict=True):
            noisy = xy + rng.normal(0, 0.2, xy.shape)
            out.append(board(ij - ij.min(axis=0), noisy, camera.image_size, np.full(len(xy), 0.2)))
    return a, b


def rig_error(found):
    D = found.T_right_left[:3, :3] @ T_RIGHT_LEFT[:3, :3].T
    return np.concatenate([Rotation.from_matrix(D).as_rotvec(), found.T_right_left[:3, 3] - D @ T_RIGHT_LEFT[:3, 3]])


def holds(found):
    error = rig_error(found)
    return error @ np.linalg.solve(found.cov, error) < 6 + 4 * np.sqrt(12)


@pytest.mark.parametrize(("a", "b"), [("pinhole", "pinhole"), ("brown", "brown"), ("fisheye", "fisheye")])
def test_a_known_rig_comes_back_within_its_deviations(a, b):
    left, right = pairs(CAMERAS[a], CAMERAS[b], 1, 10)
    found = calibrate_stereo(left, right, SPACING, model=a)
    assert holds(found)
    assert found.baseline == pytest.approx(np.linalg.norm(T_RIGHT_LEFT[:3, 3]), rel=0.03)
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.08)
    assert 0.15 < found.epipolar < 0.4
    for v, w in zip(found.left.views, found.right.views, strict=True):
        assert w.pose.T_cam_board == pytest.approx(found.T_right_left @ v.pose.T_cam_board, abs=1e-9)


def test_two_lens_models():
    left, right = pairs(BROWN, CAMERAS["fisheye"], 2, 10, spread=0.45)
    found = calibrate_stereo(left, right, SPACING)
    assert found.left.camera.model == "brown"
    assert holds(found)


@pytest.fixture(scope="module")
def pair():
    left, right = pairs(PINHOLE, PINHOLE, 3, 10)
    return left, right, calibrate_stereo(left, right, SPACING, model="pinhole")


def test_boards_that_the_border_cuts_are_pairs():
    """Near boards, each of which one of the cameras sees in part; only four are whole in both pictures."""
    rng, sides = np.random.default_rng(6), ([], [])
    while len(sides[0]) < 16:
        T = random_pose(rng, 0.5, 0.6, (0.25, 0.45))
        seen = [see(PINHOLE, T), see(PINHOLE, T_RIGHT_LEFT @ T)]
        whole = [len(ij) == 54 for ij, _ in seen]
        if min(len(ij) for ij, _ in seen) < 24 or all(whole) != (len(sides[0]) < 4):
            continue
        for side, (ij, xy) in zip(sides, seen, strict=True):
            noisy = xy + rng.normal(0, 0.2, xy.shape)
            side.append(detected(ij, noisy, PINHOLE.image_size, np.full(len(xy), 0.2)))
    bare = [[replace(b, origin_dark=None) for b in side] for side in sides]
    found, without = (calibrate_stereo(*some, SPACING, model="pinhole") for some in (sides, bare))
    shared = [
        sum(v.settled and w.settled for v, w in zip(c.left.used_views, c.right.used_views, strict=True))
        for c in (found, without)
    ]
    assert shared[0] >= 12
    assert shared[1] < 0.7 * shared[0]
    assert holds(found)
    assert (np.diag(found.cov)[3:] < 0.5 * np.diag(without.cov)[3:]).all()


def rectified(camera, R, P, xy):
    rays = unproject(camera, xy) @ R.T
    out = np.column_stack([rays, np.ones(len(rays))]) @ P.T
    # P's last column moves points, not directions: take the direction's own place
    return ((rays @ P[:, :3].T) / out[:, 2:3])[:, :2]


def test_rectified_rows_are_equal_and_q_gives_the_depth(pair):
    _, _, found = pair
    for v, w in zip(found.left.views, found.right.views, strict=True):
        points = np.column_stack([v.ij * SPACING, np.zeros(len(v))]) @ v.pose.R.T + v.pose.t
        a = rectified(found.left.camera, found.R_left, found.P_left, v.xy)
        b = rectified(found.right.camera, found.R_right, found.P_right, w.xy)
        assert np.abs(a[:, 1] - b[:, 1]).max() < 2
        assert np.sqrt(((a - b)[:, 1] ** 2).mean()) < 0.6
        back = np.column_stack([a, a[:, 0] - b[:, 0], np.ones(len(a))]) @ found.Q.T
        back = back[:, :3] / back[:, 3:]
        assert back == pytest.approx(points @ found.R_left.T, rel=0.05, abs=0.02)


def test_a_pair_is_a_rig_of_two(pair):
    left, right, found = pair
    both = calibrate_rig({"left": left, "right": right}, SPACING, model="pinhole")
    T, cov = both.rig.relative("left", "right")
    assert found.T_right_left == pytest.approx(T, abs=1e-9)
    assert found.cov == pytest.approx(np.asarray(cov), rel=1e-6, abs=1e-15)
    assert found.rms == pytest.approx(both.rms, rel=1e-9)
    for name, side in (("left", found.left), ("right", found.right)):
        assert side.camera.parameters == pytest.approx(both.cameras[name].camera.parameters, rel=1e-9)
        assert side.cov == pytest.approx(both.cameras[name].cov, rel=1e-6, abs=1e-12)


def test_joint_covariances_beat_those_of_each_camera(pair):
    from rcdn.calibration import calibrate

    left, right, found = pair
    alone = calibrate(left, SPACING, model="pinhole"), calibrate(right, SPACING, model="pinhole")
    for mono, joint in zip(alone, (found.left, found.right), strict=True):
        assert joint.cov.shape == (10, 10)
        assert (joint.std < 1.02 * mono.std).all()
        assert np.linalg.eigvalsh(joint.cov).min() > 0


def test_the_rig_s_covariance_holds_its_errors():
    """Squares of error by covariance are a chi-square of 6 degrees: their mean over 4 rigs is 6 ± 1.7."""
    squares = []
    for seed in range(10, 14):
        found = calibrate_stereo(*pairs(PINHOLE, PINHOLE, seed, 6), SPACING, model="pinhole")
        error = rig_error(found)
        squares.append(error @ np.linalg.solve(found.cov, error))
    assert 2 < np.mean(squares) < 11


def test_parts_in_one_camera_help_its_lens_only():
    left, right = pairs(BROWN, BROWN, 0, 12, least=0.5, spread=0.5)
    assert any(len(b) < 54 for b in right)
    found = calibrate_stereo(left, right, SPACING, model="brown")
    assert holds(found)
    assert len(found.left.used_views) == len(found.right.used_views) == 12


@pytest.mark.parametrize("size", [(8, 6), (6, 6)])
def test_symmetric_boards_that_are_labelled_from_any_side(size):
    left, right = pairs(PINHOLE, PINHOLE, 4, 8, size=size)
    turns = (0, 1, 2, 3) if size == (6, 6) else (0, 2)
    rng, kind = np.random.default_rng(0), "ambiguous_90" if size == (6, 6) else "ambiguous_180"

    def turned(b):
        return replace(b, ij=turn_labels(b.ij, size, int(rng.choice(turns))), orientation=kind)

    found = calibrate_stereo([turned(b) for b in left], [turned(b) for b in right], SPACING, model="pinhole")
    assert holds(found)
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.1)
    assert len(found.left.used_views) == 8
    for v, w in zip(found.left.views, found.right.views, strict=True):
        at = {tuple(i): k for k, i in enumerate(w.ij.tolist())}
        both = [at[tuple(i)] for i in v.ij.tolist()]
        points = np.column_stack([v.ij * SPACING, np.zeros(len(v))]) @ v.pose.R.T + v.pose.t
        in_right = points @ found.T_right_left[:3, :3].T + found.T_right_left[:3, 3]
        rays = unproject(found.right.camera, w.xy[both])
        assert in_right[:, :2] / in_right[:, 2:] == pytest.approx(rays[:, :2], abs=0.01)


def test_wrong_pairs_are_left_out_of_the_place_and_named(pair):
    left, right, _ = pair
    swapped = [right[k] for k in (1, 0, *range(2, 10))]
    names = [f"l{k}.png" for k in range(10)], [f"r{k}.png" for k in range(10)]
    found = calibrate_stereo(left, swapped, SPACING, model="pinhole", names=names)
    assert holds(found)
    assert found.advice[0].startswith("2 pairs disagree")
    assert all(name in found.advice[0] for name in ("l0.png", "r0.png", "l1.png", "r1.png"))
    assert "l2.png" not in found.advice[0]


def test_pairs_of_other_moments_are_refused(pair):
    left, right, _ = pair
    mixed = [right[k] for k in (5, 3, 8, 0, 7, 9, 2, 6, 1, 4)]
    with pytest.raises(
        CalibrationError, match=r"only 1 of 10 pairs agrees on where the cameras stand: are the pictures paired"
    ):
        calibrate_stereo(left, mixed, SPACING, model="pinhole")


@pytest.mark.parametrize("by", [1, -1, 2])
def test_a_constant_offset_of_the_pictures_is_named(pair, by):
    left, right, _ = pair
    names = [f"l{k}.png" for k in range(10)], [f"r{k}.png" for k in range(10)]
    late = [right[(k - by) % 10] for k in range(10)]
    first = (
        "l0.png then belongs to r1.png"
        if by == 1
        else "l1.png then belongs to r0.png"
        if by == -1
        else "l0.png then belongs to r2.png"
    )
    with pytest.raises(
        CalibrationError,
        match=f"{10 - abs(by)} would if the right pictures were shifted by {abs(by)}: {first}, and so on. "
        r"Name the pairs \(--pairs; in Python pairs\)",
    ):
        calibrate_stereo(left, late, SPACING, model="pinhole", names=names)


@pytest.mark.parametrize("side", [0, 1])
def test_a_mirrored_camera_is_named(pair, side):
    def mirror(b):
        """As a detector labels a mirrored picture of 9×6 corners (the test below): right-handed there."""
        return replace(b, xy=b.xy * [-1, 1] + [639, 0], ij=b.ij * [1, -1] + [0, 5])

    both = list(pair[:2])
    both[side] = [mirror(b) for b in both[side]]
    with pytest.raises(CalibrationError, match="mirrored: turn its mirror"):
        calibrate_stereo(*both, SPACING, model="pinhole")


@pytest.mark.parametrize("size", [(9, 6), (8, 5)])
def test_labels_of_a_mirrored_picture_run_the_other_way_along_the_even_side(size):
    squares = np.kron(np.indices((size[1] + 1, size[0] + 1)).sum(0) % 2, np.ones((30, 30)))
    picture = np.uint8(60 + 120 * np.pad(squares, 50, constant_values=1))
    (there,), (here,) = (rcdn.Detector().detect(p).boards for p in (picture, picture[:, ::-1].copy()))
    assert there.size == here.size == size
    axis = reversed_in_a_mirror(size)
    labels = here.ij.copy()
    labels[:, axis] = size[axis] - 1 - labels[:, axis]
    at = {tuple(ij): xy for ij, xy in zip(labels.tolist(), here.xy, strict=True)}
    back = np.array([at[tuple(ij)] for ij in there.ij.tolist()]) * [-1, 1] + [picture.shape[1] - 1, 0]
    assert back == pytest.approx(there.xy, abs=0.05)


def test_one_camera_twice_is_refused(pair):
    with pytest.raises(ConfigError, match="the same boards, corner by corner"):
        calibrate_stereo(pair[0], pair[0], SPACING)


def test_cameras_the_other_way_round_are_told(pair):
    left, right, found = pair
    assert swapped_hint(found) == ""
    swapped = swapped_hint(calibrate_stereo(right, left, SPACING, model="pinhole"))
    assert re.search(r"right camera stands 0\.1\d+ m to the left of the left one", swapped)


def test_boards_that_one_camera_saw_help(pair):
    left, right, _ = pair
    half = [(k, k) for k in range(5)]
    few = calibrate_stereo(left[:5], right[:5], SPACING, model="pinhole")
    more = calibrate_stereo(left, right[:5], SPACING, model="pinhole", pairs=half)
    assert (more.left.std < 1.1 * few.left.std).all()  # the scatter of few views is known roughly only
    assert (more.left.std / few.left.std).mean() < 1
    assert holds(more)
    assert len(more.left.views) == 10
    assert [v.name for v in more.left.views[:5]] == [v.name for v in more.right.views]


def test_wrong_pairs_arguments(pair):
    left, right, _ = pair
    with pytest.raises(ConfigError, match="left has 10 boards, right 5"):
        calibrate_stereo(left, right[:5], SPACING)
    with pytest.raises(ConfigError, match="pairs must hold"):
        calibrate_stereo(left, right, SPACING, pairs=[(0, 10)])
    with pytest.raises(CalibrationError, match="only 2 pairs show the whole board"):
        calibrate_stereo(left, right, SPACING, model="pinhole", pairs=[(0, 0), (1, 1)])


@pytest.mark.parametrize("pairs", [[(0, 0), (0, 0), (1, 1)], [(0, 0), (1, 0), (2, 2)]])
def test_a_board_is_in_one_pair_only(pair, pairs):
    with pytest.raises(ConfigError, match="pairs"):
        calibrate_stereo(*pair[:2], SPACING, model="pinhole", pairs=pairs)


def test_different_boards_are_refused():
    left, _ = pairs(PINHOLE, PINHOLE, 0, 4)
    _, right = pairs(PINHOLE, PINHOLE, 0, 4, size=(11, 8))
    with pytest.raises(CalibrationError, match="board"):
        calibrate_stereo(left, right, SPACING, model="pinhole")


def test_lenses_that_are_given_are_held():
    """Three pairs hardly tell two lenses, but where the cameras stand, if both are known."""
    left, right = pairs(BROWN, BROWN, 21, 3)
    found = calibrate_stereo(left, right, SPACING, cameras=(BROWN, BROWN))
    assert found.given == ("left", "right")
    for side in (found.left, found.right):
        np.testing.assert_array_equal(side.camera.parameters, BROWN.parameters)
        assert not side.cov[: len(BROWN.parameters), : len(BROWN.parameters)].any()
        assert side.verdict.level in ("good", "fair")
    assert holds(found)
    free = calibrate_stereo(left, right, SPACING, model="brown")
    assert (np.diag(found.cov)[3:] < 0.5 * np.diag(free.cov)[3:]).all()


def test_the_lens_that_is_not_given_is_solved_for():
    left, right = pairs(BROWN, PINHOLE, 22, 10)
    found = calibrate_stereo(left, right, SPACING, cameras=(BROWN, None), model="pinhole")
    assert found.given == ("left",)
    np.testing.assert_array_equal(found.left.camera.parameters, BROWN.parameters)
    assert found.right.camera.model == "pinhole"
    assert (np.abs(found.right.camera.parameters - PINHOLE.parameters) < 4 * found.right.std).all()
    assert (found.right.std > 0).all()
    assert holds(found)


def test_a_lens_that_is_not_the_camera_s_is_doubted():
    left, right = pairs(BROWN, BROWN, 23, 8)
    zoomed = replace(BROWN, K=BROWN.K * np.array([[1.03, 1, 1], [1, 1.03, 1], [1, 1, 1]]))
    found = calibrate_stereo(left, right, SPACING, cameras=(zoomed, BROWN))
    assert found.verdict.level in ("fair", "unsure", "bad")
    assert any("Calibrate without the given lens" in r.action for r in found.verdict.against)
    for verdict in (found.left.verdict, found.verdict):  # and nothing else is recommended against its residuals
        actions = {r.key.removeprefix("left."): r.action for r in verdict.against}
        assert all("without the given lens" in actions[key] for key in ("systematic", "rms") if key in actions)
    assert not any("Try another lens model" in text for text in (*found.left.advice, *found.advice))


def test_a_given_camera_of_another_size_is_refused(pair):
    left, right, _ = pair
    small = replace(PINHOLE, image_size=(320, 240))
    with pytest.raises(CalibrationError, match="right camera: its pictures have 640×480 px"):
        calibrate_stereo(left, right, SPACING, cameras=(None, small))


@pytest.mark.parametrize("cameras", [(None, None), (BROWN, None), (BROWN, BROWN)])
def test_boards_of_another_size_are_left_out_where_the_size_is_named(cameras):
    left, right = pairs(BROWN, BROWN, 24, 8)
    larger = pairs(BROWN, BROWN, 26, 3, size=(11, 8))
    both = left + larger[0], right + larger[1]
    found = calibrate_stereo(*both, SPACING, cameras=cameras, model="brown", size=(9, 6))
    for side in (found.left, found.right):
        assert [len(v) for v in side.left_out] == [88] * 3
        assert all(len(v) == 54 for v in side.used_views)


@pytest.mark.parametrize("cameras", [None, (BROWN,), (BROWN, BROWN, None), ("left.yaml", None), {"left": BROWN}])
def test_lenses_that_are_no_pair_are_refused(pair, cameras):
    left, right, _ = pair
    with pytest.raises(ConfigError, match=r"cameras must be \(left, right\)"):
        calibrate_stereo(left, right, SPACING, cameras=cameras)


def test_a_model_that_does_not_exist_is_refused_beside_known_lenses(pair):
    left, right, _ = pair
    with pytest.raises(ConfigError, match="model must be one of"):
        calibrate_stereo(left, right, SPACING, cameras=(PINHOLE, PINHOLE), model="nonsense")


@pytest.mark.parametrize("given", [("middle",), ("right", "left"), ("left", "left")])
def test_given_names_the_sides_once(pair, given):
    with pytest.raises(RcdnError, match="given must hold"):
        replace(pair[2], given=given)


def test_smooth_corrections_of_a_pair_keep_their_stiffness():
    """Without their prior the control points that no corner tells of leave the focal length open."""
    left, right = pairs(BROWN, BROWN, 27, 10)
    found = calibrate_stereo(left, right, SPACING, model="splined")
    for side in (found.left, found.right):
        assert side.camera.correction is not None
        assert (side.std[:2] < 0.02 * side.camera.parameters[:2]).all()
        assert (np.abs(side.camera.parameters[:2] - BROWN.parameters[:2]) < 5 * side.std[:2]).all()
    assert holds(found)
