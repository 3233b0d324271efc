"""Where a board stands by all cameras of a rig: known places, turns of labels, cameras that disagree,
and honest deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import estimate_pose, estimate_rig_pose
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry import rotation
from rcdn.geometry.order import turn_labels
from rcdn.types import Pose, Rig
from rcdn_lab.camera_scenes import SIZE, SPACING, board, random_pose, see
from rcdn_lab.rig_scenes import row

SCENE = row([0.25, 0.25], ("brown", "fisheye", "brown"))
NAMES = tuple(SCENE.places)


def rig(covariance=None):
    first = np.linalg.inv(SCENE.places[NAMES[0]])
    return Rig(
        NAMES,
        tuple(SCENE.cameras.values()),
        tuple(Pose(T @ first) for T in SCENE.places.values()),
        covariance,
    )


def shown(rng, noise=0.1, size=SIZE):
    """A board that all three cameras see whole, and T_rig_board."""
    made = rig()
    while True:
        T = np.linalg.inv(made.poses[1].T_cam_board) @ random_pose(rng, 0.1, 0.6, (0.7, 1.0), size)
        seen = {n: see(c, p.T_cam_board @ T, size) for n, c, p in zip(NAMES, made.cameras, made.poses, strict=True)}
        if all(len(ij) == size[0] * size[1] for ij, _ in seen.values()):
            return {
                n: board(ij, xy + rng.normal(0, noise, xy.shape), (640, 480), np.full(len(xy), noise))
                for n, (ij, xy) in seen.items()
            }, T


def motion(T, U):
    D = U @ np.linalg.inv(T)
    return np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])


def test_all_cameras_together_know_better_than_one():
    rng, joint, alone = np.random.default_rng(0), [], []
    for _ in range(10):
        boards, T = shown(rng)
        joint.append(motion(estimate_rig_pose(boards, rig(), SPACING).T_rig_board, T)[3:])
        alone.append(motion(estimate_pose(boards["c0"], rig().cameras[0], SPACING).T_cam_board, T)[3:])
    assert np.sqrt(np.mean(np.square(joint))) < 0.5 * np.sqrt(np.mean(np.square(alone)))


def test_the_covariance_holds_that_of_the_cameras_places():
    """Rigs drawn from their own covariance: errors are as large as stated."""
    rng, squares = np.random.default_rng(1), []
    root = np.zeros((18, 18))
    root[6:, 6:] = np.diag(np.tile([2e-3] * 3 + [2e-3] * 3, 2))
    for _ in range(40):
        boards, T = shown(rng, noise=0.05)
        off = root @ rng.normal(size=18)
        made = rig(root @ root.T)
        poses = []
        for k, pose in enumerate(made.poses):
            move = np.eye(4)
            move[:3, :3], move[:3, 3] = rotation(off[6 * k : 6 * k + 3]), off[6 * k + 3 : 6 * k + 6]
            poses.append(Pose(move @ pose.T_cam_board))
        found = estimate_rig_pose(boards, replace(made, poses=tuple(poses)), SPACING)
        gap = motion(found.T_rig_board, T)
        squares.append(gap @ np.linalg.solve(found.cov, gap) / 6)
    assert 0.5 < np.mean(squares) < 1.3


def test_labels_that_are_turned_in_one_camera_follow_the_others():
    boards, T = shown(np.random.default_rng(2), size=(8, 6))
    plain = {n: replace(b, orientation="ambiguous_180") for n, b in boards.items()}
    plain["c1"] = replace(plain["c1"], ij=turn_labels(plain["c1"].ij, (8, 6), 2))
    found = estimate_rig_pose(plain, rig(), SPACING)
    assert not found.left_out
    assert np.linalg.norm(motion(found.T_rig_board, T)[3:]) < 0.003 or np.linalg.norm(
        motion(found.T_rig_board, T)[:3]
    ) == pytest.approx(np.pi, abs=0.05)


def test_a_camera_that_sees_the_board_elsewhere_is_left_out_and_named():
    boards, T = shown(np.random.default_rng(3))
    boards["c2"] = replace(boards["c2"], xy=boards["c2"].xy + np.array([60.0, 0.0]))
    found = estimate_rig_pose(boards, rig(), SPACING)
    assert list(found.left_out) == ["c2"]
    assert "elsewhere" in found.left_out["c2"]
    assert set(found.residuals) == {"c0", "c1"}
    assert np.linalg.norm(motion(found.T_rig_board, T)[3:]) < 0.01


def test_deviations_of_the_position_are_those_of_the_position_itself():
    boards, T = shown(np.random.default_rng(7), noise=1e-9)
    rng, off, told, sigma = np.random.default_rng(8), [], [], np.full(len(boards["c0"]), 0.1)
    for _ in range(60):
        noisy = {n: replace(b, xy=b.xy + rng.normal(0, 0.1, b.xy.shape), sigma=sigma) for n, b in boards.items()}
        found = estimate_rig_pose(noisy, rig(), SPACING)
        off.append((found.T_rig_board - T)[:3, 3])
        told.append(found.std[3:])
    assert np.sqrt(np.mean(np.square(off), axis=0)) / np.mean(told, axis=0) == pytest.approx(np.ones(3), abs=0.25)


def test_part_of_a_plain_board_tells_nothing_beside_the_whole():
    boards, _ = shown(np.random.default_rng(4))
    some = boards["c1"].ij[:, 0] < 5
    part = boards["c1"]
    boards["c1"] = board(part.ij[some], part.xy[some], (640, 480), part.sigma[some])
    assert "part of the board" in estimate_rig_pose(boards, rig(), SPACING).left_out["c1"]


def test_one_camera_gives_its_own_pose_in_the_rigs_frame():
    boards, _ = shown(np.random.default_rng(5))
    made = rig()
    found = estimate_rig_pose({"c1": boards["c1"]}, made, SPACING)
    alone = estimate_pose(boards["c1"], made.cameras[1], SPACING)
    assert made.poses[1].T_cam_board @ found.T_rig_board == pytest.approx(alone.T_cam_board, abs=1e-6)


def test_wrong_arguments_are_named():
    boards, _ = shown(np.random.default_rng(6))
    with pytest.raises(ConfigError, match="one camera at least"):
        estimate_rig_pose({}, rig(), SPACING)
    with pytest.raises(Exception, match="no camera 'other'"):
        estimate_rig_pose({"other": boards["c0"]}, rig(), SPACING)
    with pytest.raises(ConfigError, match=r"boards\['c0'\]: the picture has"):
        estimate_rig_pose({"c0": replace(boards["c0"], image_size=(320, 240))}, rig(), SPACING)
    line = replace(boards["c0"], xy=np.full_like(boards["c0"].xy, 100.0))
    with pytest.raises(CalibrationError, match="c0: "):
        estimate_rig_pose({"c0": line}, rig(), SPACING)


def test_cameras_whose_place_is_unsure_weigh_less():
    boards, _ = shown(np.random.default_rng(8))
    vague = np.zeros((18, 18))
    vague[6:, 6:] = np.diag(np.tile([1e-2**2] * 6, 2))
    alone = estimate_rig_pose({"c0": boards["c0"]}, rig(vague), SPACING)
    joint = estimate_rig_pose(boards, rig(vague), SPACING)
    sure = estimate_rig_pose(boards, rig(np.zeros((18, 18))), SPACING)
    assert (joint.std <= 1.01 * alone.std).all()
    assert (sure.std[3:] < joint.std[3:]).all()
