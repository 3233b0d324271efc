"""Boards that are fixed to each other: their places are unknowns of the same bundle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig
from rcdn.calibration.bundle import Corners3, State, default_free, linearise, residuals
from rcdn.calibration.hand_eye import hand_eye
from rcdn.calibration.solver import solve
from rcdn.errors import CalibrationError
from rcdn.geometry import rotation
from rcdn.types import Charuco
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, labels, random_pose, see
from rcdn_lab.rig_scenes import look_at


def placed(turn, t):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.array(turn, float)), t
    return T


def gap(T, U):
    """The small motion (6,) after T that gives U."""
    D = U @ np.linalg.inv(T)
    return np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])


def three_boards(seed=0, frames=4):
    """Two cameras and three boards fixed to each other, the first with a shape of one function; each frame shows all to
    both."""
    rng = np.random.default_rng(seed)
    poses = np.array([random_pose(rng, spread=0.1, tilt=0.4, distance=(0.9, 1.2)) for _ in range(frames)])
    rig = np.stack([np.eye(4), placed([0.02, -0.15, 0.05], [-0.12, 0.01, 0.03])])
    boards = np.stack([np.eye(4), placed([0, 0.5, 0.1], [0.26, 0, -0.02]), placed([0.6, 0, 0], [0, -0.2, 0.05])])
    shape = np.array([[0.001, -0.0005, 0.003]])
    state = State((CAMERAS["brown"], CAMERAS["fisheye"]), poses, rig, shape, boards=boards)
    ij, each = labels(), 54
    frame = np.repeat(np.arange(frames), 6 * each)
    camera = np.tile(np.repeat([0, 1], 3 * each), frames)
    part = np.tile(np.repeat([0, 1, 2], each), 2 * frames)
    board = np.tile(ij * SPACING, (6 * frames, 1))
    bend = np.tile(1 - (ij[:, :1] / 4.0 - 1) ** 2, (6 * frames, 1)) * (part == 0)[:, None]
    corners = Corners3(frame, camera, board, np.zeros((len(frame), 2)), bend, part)
    xy = linearise(state, corners)[0]
    return state, Corners3(frame, camera, board, xy + rng.normal(0, 0.2, xy.shape), bend, part)


def test_derivatives_by_all_unknowns_are_those_of_differences():
    state, corners = three_boards()
    _, by_frame, by_shared = linearise(state, corners)
    count = sum(state.counts)
    assert count == 9 + 8 + 6 + 12 + 3

    def slope(of_motion, of_shared):
        ahead, behind = (linearise(state.moved(s * of_motion, s * of_shared), corners)[0] for s in (1e-6, -1e-6))
        return (ahead - behind) / 2e-6

    for k in range(6):
        d = np.zeros((4, 6))
        d[:, k] = 1
        assert by_frame[:, :, k] == pytest.approx(slope(d, np.zeros(count)), rel=1e-5, abs=1e-3)
    for k in range(count):
        d = np.zeros(count)
        d[k] = 1
        assert by_shared[:, :, k] == pytest.approx(slope(np.zeros((4, 6)), d), rel=1e-5, abs=1e-3)
    assert residuals(state, corners) == pytest.approx(corners.xy - linearise(state, corners)[0], abs=1e-12)


def test_the_places_of_boards_come_back_from_a_start_that_is_off():
    state, corners = three_boards(frames=8)
    rng = np.random.default_rng(1)
    shared = np.zeros(sum(state.counts))
    shared[17:35] = rng.normal(0, 0.01, 18)
    free = default_free(state, rig=True)
    done = solve(state.moved(rng.normal(0, 0.01, (8, 6)), shared), corners, np.full(len(corners), 5.0), free)
    assert done.state.boards[0] == pytest.approx(np.eye(4))
    cov = done.arrow.covariance[23:35, 23:35]  # of the boards, after 17 numbers of lenses and 6 of the second camera
    error = np.concatenate([gap(*both) for both in zip(done.state.boards[1:], state.boards[1:], strict=True)])
    assert error @ np.linalg.solve(cov, error) < 12 + 4 * np.sqrt(24)
    assert np.abs(error).max() < 0.01


FRONT, BACK = Charuco(10, 7, "DICT_4X4_100", 0.75), Charuco(10, 7, "DICT_4X4_100", 0.75, first_id=40)
T_FRONT_BACK = placed([0, np.pi, 0], [8 * SPACING, 0.01, 0.006])
"""the back of a plate of 6 mm, printed 1 cm lower"""


def plate(eyes, moments=30, seed=5, noise=0.1, away=T_FRONT_BACK, turns=0.35):
    """What cameras at `eyes` see of a plate with a board on each side, moved about the origin; T_cam_world of each."""
    rng = np.random.default_rng(seed)
    places = {name: look_at(np.array(eye, float), np.zeros(3)) for name, eye in eyes.items()}
    views, when = {name: [] for name in eyes}, {name: [] for name in eyes}
    upright = placed([-np.pi / 2, 0, 0], [0, 0, 0])  # the front towards −y of the world, its y axis downwards
    middle = placed([0, 0, 0], [*-(np.array(SIZE) - 1) * SPACING / 2, 0])
    for m in range(moments):
        move = placed(rng.normal(0, turns, 3), rng.uniform(-0.08, 0.08, 3))
        for name, T in places.items():
            for target, T_front in ((FRONT, np.eye(4)), (BACK, away)):
                pose = T @ move @ upright @ middle @ T_front
                ij, xy = see(CAMERAS["brown"], pose)
                if pose[:3, 2] @ pose[:3, 3] > 0.3 * np.linalg.norm(pose[:3, 3]) and len(ij) == 54:
                    noisy = xy + rng.normal(0, noise, xy.shape)
                    found = board(ij, noisy, (640, 480), np.full(len(xy), noise))
                    views[name].append(replace(found, target=target, ids=target.ids(ij)))
                    when[name].append(str(m))
    return views, when, places


def holds(found, places, first, second):
    """A relative pose lies within its deviations and near the truth."""
    T, cov = found.rig.relative(first, second)
    error = gap(T, places[second] @ np.linalg.inv(places[first]))
    assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)
    assert np.linalg.norm(error[3:]) < 0.01


def test_cameras_that_face_each_other_are_joined_by_the_two_sides_of_a_plate():
    """Neither ever sees the other's board: both places follow from how the plate was turned."""
    views, when, places = plate({"front": (0, -0.6, 0.05), "back": (0.05, 0.62, 0)})
    assert {b.target for b in views["front"]}.isdisjoint({b.target for b in views["back"]})
    found = calibrate_rig(views, SPACING, moments=when, model="brown", fixed_boards=True)
    assert found.components == (("front", "back"),)
    holds(found, places, "front", "back")
    first, other = found.fixed_boards
    assert first.T_first_board == pytest.approx(np.eye(4))
    truth = T_FRONT_BACK if str(other.target) == str(BACK) else np.linalg.inv(T_FRONT_BACK)
    error = gap(other.T_first_board, truth)
    assert error @ np.linalg.solve(other.cov, error) < 6 + 4 * np.sqrt(12)
    assert np.linalg.norm(error[3:]) < 0.002
    with pytest.raises(CalibrationError, match="no two cameras"):
        calibrate_rig(views, SPACING, moments=when, model="brown")


def test_cameras_around_a_plate_are_joined_by_what_some_see_together():
    """Four cameras around the plate: neighbours share a side from time to time."""
    eyes = {"a": (-0.3, -0.6, 0), "b": (0.35, -0.55, 0.05), "c": (0.3, 0.6, 0), "d": (-0.35, 0.6, 0.05)}
    views, when, places = plate(eyes)
    found = calibrate_rig(views, SPACING, moments=when, model="brown", fixed_boards=True)
    assert found.components == (("a", "b", "c", "d"),)
    holds(found, places, "a", "c")
    holds(found, places, "b", "d")
    assert {key[1] for key in found.boards} == {b.target for b in found.fixed_boards}
    view = next(v for v in found.cameras["c"].views if not v.reason)
    moment = when["c"][found.cameras["c"].views.index(view)]
    poses = [T for (m, _), T in found.boards.items() if m == moment]
    T = found.rig.poses[2].T_cam_board
    assert min(np.abs(T @ P - view.pose.T_cam_board).max() for P in poses) < 1e-9


def test_boards_that_are_moved_one_by_one_are_not_taken_as_fixed():
    """Each camera moves its own board: what they say of each other is by chance."""
    eyes = {"front": (0, -0.6, 0.05), "beside": (0.3, -0.55, 0), "back": (0.05, 0.62, 0)}
    views, when, _ = plate(eyes)
    others, late, _ = plate(eyes, seed=9)
    views, when = {**views, "back": others["back"]}, {**when, "back": late["back"]}
    found = calibrate_rig(views, SPACING, moments=when, model="brown", fixed_boards=True)
    assert found.rig.names == ("front", "beside")
    assert found.components == (("front", "beside"), ("back",))


def test_a_rig_that_moves_among_boards_on_the_walls():
    """Each camera looks at a wall of its own and sees no other's board; the rig is turned and moved."""
    rng = np.random.default_rng(4)
    targets = [Charuco(10, 7, "DICT_4X4_250", 0.75, first_id=40 * k) for k in range(3)]
    turns = (0.0, 1.2, -1.1)
    walls = [placed([0, t, 0], 0.7 * np.array([np.sin(t), 0, np.cos(t)])) for t in turns]  # T_room_board's wall
    middle = placed([0, 0, 0], [*-(np.array(SIZE) - 1) * SPACING / 2, 0])
    cameras = {
        f"c{k}": np.linalg.inv(placed([0.05 * k, t, 0], [0.05 * k, 0.02, 0.03 * k])) for k, t in enumerate(turns)
    }
    views, when = {n: [] for n in cameras}, {n: [] for n in cameras}
    for m in range(30):
        move = placed(rng.normal(0, 0.2, 3), rng.uniform(-0.12, 0.12, 3))
        for name, T in cameras.items():
            for target, wall in zip(targets, walls, strict=True):
                pose = T @ move @ wall @ middle
                ij, xy = see(CAMERAS["brown"], pose)
                if pose[2, 3] > 0.2 and len(ij) == 54:
                    found = board(ij, xy + rng.normal(0, 0.1, xy.shape), (640, 480), np.full(54, 0.1))
                    views[name].append(replace(found, target=target, ids=target.ids(ij)))
                    when[name].append(str(m))
    found = calibrate_rig(views, SPACING, moments=when, model="brown", fixed_boards=True)
    assert found.components == (("c0", "c1", "c2"),)
    assert len({b.first for b in found.fixed_boards}) == 1
    holds(found, cameras, "c0", "c1")
    holds(found, cameras, "c1", "c2")


def test_two_unknown_poses_come_from_turned_boards_and_not_from_turns_about_one_axis():
    rng = np.random.default_rng(2)
    Y, X = placed([0.3, 2.5, 0.1], [0.1, -0.2, 1.2]), placed([0, 3, 0.2], [0.2, 0, 0.01])
    A = np.array([placed(rng.normal(0, 0.4, 3), rng.normal([0, 0, 0.6], 0.1)) for _ in range(12)])
    B = Y @ A @ X
    B[3, :3, 3] += 0.5  # of another moment
    found = hand_eye(A, B, np.full(12, 0.6))
    assert found is not None
    assert found[0] == pytest.approx(Y, abs=1e-9)
    assert found[1] == pytest.approx(X, abs=1e-9)
    assert found[2] == 11
    about_one = np.array([placed([0, a, 0], [0, 0, 0.6]) for a in rng.normal(0, 0.5, 12)])
    assert hand_eye(about_one, Y @ about_one @ X, np.full(12, 0.6)) is None
    assert hand_eye(A, rng.permutation(Y @ A @ X), np.full(12, 0.6)) is None
