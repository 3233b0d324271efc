"""Cameras, pairs and poses from boards with codes: parts at their places on the target, tags with gaps,
several kinds in one set."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from coded_views import APRILGRID, CHARUCO, all_places, coded_board, coded_boards, places, pose_before, seen_part

from rcdn.calibration import calibrate, calibrate_stereo, estimate_pose
from rcdn.calibration.coded import Geometries
from rcdn.calibration.tag_gap import gap_of
from rcdn.errors import ConfigError
from rcdn.geometry import project
from rcdn.types import Charuco, PuzzleBoard
from rcdn_lab.camera_scenes import CAMERAS, random_boards

CAMERA = CAMERAS["brown"]
TARGETS = {"charuco": CHARUCO, "aprilgrid": APRILGRID, "puzzleboard": PuzzleBoard()}
SIDES = {"charuco": 0.03, "aprilgrid": 0.04, "puzzleboard": 0.025}


def parameters_off(found, camera=CAMERA):
    """The focal lengths' and the principal point's errors in their own standard deviations, and in px."""
    off = found.camera.parameters[:4] - camera.parameters[:4]
    return np.abs(off / found.std[:4]).max(), np.abs(off).max()


@pytest.mark.parametrize("kind", TARGETS)
def test_parts_of_a_coded_board_give_the_camera(kind):
    boards, poses = coded_boards(CAMERA, TARGETS[kind], SIDES[kind], seed=3)
    found = calibrate(boards, SIDES[kind], model="brown")
    share, px = parameters_off(found)
    assert share < 4
    assert px < 2
    assert found.rms < 0.16  # two axes of 0.1 px are 0.141
    assert found.target is not None
    assert found.target.kind == kind
    assert found.orientation == "unique"
    assert all(v.settled for v in found.views)
    first = Geometries.of(boards, SIDES[kind]).main.first
    start = places(TARGETS[kind], first[None], SIDES[kind])[0]
    for view, T in zip(found.views, poses, strict=True):
        origin = T[:3, :3] @ start + T[:3, 3]  # of the label that counts as (0, 0)
        assert np.linalg.norm(view.pose.t - origin) < 0.01 * np.linalg.norm(origin)
    assert (found.views[0].ids == boards[0].ids).all()


def test_tags_taken_for_squares_would_give_no_such_camera():
    """The gap is in the geometry: without it corners lie far off."""
    boards, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=3, share=1)
    squares = [replace(b, pattern="checker", target=None, ids=None) for b in boards]
    good, bad = (calibrate(some, 0.04, model="brown", flat=True) for some in (boards, squares))
    assert bad.noise > 10 * good.noise


def test_a_gap_that_was_read_a_little_wrong_is_measured():
    """Codes don't say it; the corners do."""
    true = replace(APRILGRID, gap=0.2945)
    boards, _ = coded_boards(CAMERA, true, 0.04, seed=4)
    read = [replace(b, target=APRILGRID) for b in boards]
    assert gap_of(read) == pytest.approx(0.2945, abs=0.001)
    assert gap_of(boards) == 0.2945
    assert calibrate(read, 0.04, model="brown").rms < 0.17


def test_two_kinds_of_target_in_one_set():
    one, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=8)
    other, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=6, views=7)
    found = calibrate([*one, *other], {"charuco": 0.03, "aprilgrid": 0.04}, model="brown")
    share, px = parameters_off(found)
    assert share < 4
    assert px < 2
    assert found.rms < 0.16
    assert {v.spacing for v in found.views} == {0.03, 0.04}
    assert found.target == CHARUCO
    assert any("several targets" in text for text in found.advice)


def test_one_spacing_of_two_kinds_is_refused():
    one, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=4)
    other, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=6, views=4)
    with pytest.raises(ConfigError, match=r"2 kinds \(charuco, aprilgrid\).*--spacing charuco=30mm"):
        calibrate([*one, *other], 0.03)
    with pytest.raises(ConfigError, match="kinds of boards are checker"):
        calibrate(one, {"charucco": 0.03})
    with pytest.raises(ConfigError, match="must name the kinds of the boards, charuco"):
        calibrate(one, {"aprilgrid": 0.03})
    with pytest.raises(ConfigError, match="spacing is the side of one square"):
        calibrate(one, {"charuco": -1})


def test_a_kind_without_a_spacing_is_left_out_and_says_why():
    one, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=8)
    other, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=6, views=2)
    found = calibrate([*one, *other], {"charuco": 0.03}, model="brown")
    assert ["another target" in v.reason for v in found.views] == [False] * 8 + [True] * 2


def test_boards_that_were_not_read_count_only_as_parts_at_an_unknown_place():
    one, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=10)
    lost = replace(one[0], target=None, ids=None, ij=one[0].ij - one[0].ij.min(axis=0))
    wide, _ = random_boards(CAMERA, 7, 1, whole=True)  # 9 × 6 corners can't be part of 8 × 6 ones
    found = calibrate([lost, *one[1:], *wide], 0.03, model="brown")
    assert found.views[0].reason == ""
    assert not found.views[0].settled
    assert "can't be part of the ChArUco 9x7" in found.views[-1].reason
    assert any("codes of 1 of the used views were not read" in text for text in found.advice)
    with pytest.raises(
        ConfigError, match=r"name the spacing of each kind \(checker=25mm,.*=30mm; in Python a dict of metres\)"
    ):
        calibrate([*one[:3], *wide * 4], 0.03)


def test_a_size_must_be_that_of_the_codes():
    boards, _ = coded_boards(CAMERA, CHARUCO, 0.03, seed=5, views=6)
    assert calibrate(boards, 0.03, size=(8, 6), model="brown").size == (8, 6)
    with pytest.raises(ConfigError, match="codes say 8×6"):
        calibrate(boards, 0.03, size=(9, 6))
    open_end = [replace(b, target=replace(CHARUCO, rows=None)) for b in boards]
    assert calibrate(open_end, 0.03, size=(8, 9), model="brown").size == (8, 9)


def test_views_left_out_by_hand_keep_their_place_on_the_target():
    boards, _ = coded_boards(CAMERA, APRILGRID, 0.04, seed=3)
    found = calibrate(boards, 0.04, model="brown", names=[f"{k}" for k in range(len(boards))], leave_out=["2"])
    view = found.views[2]
    assert view.reason
    assert (view.ij == boards[2].ij).all()
    assert view.rms < 0.3


# ---- poses in the target's own coordinates


def opencv_pose(points, xy, camera=CAMERA):
    _, r, t = cv2.solvePnP(points, xy, camera.K, camera.distortion, flags=cv2.SOLVEPNP_ITERATIVE)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(r)[0], t.ravel()
    return T


def test_the_pose_of_a_charuco_board_is_in_the_coordinates_of_opencvs_board():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners = cv2.aruco.CharucoBoard((9, 7), 0.03, 0.0225, dictionary).getChessboardCorners()
    rng = np.random.default_rng(0)
    for share in (1, 0.5):
        board = seen_part(rng, CAMERA, pose_before(rng, CHARUCO, 0.03, spread=0.1), CHARUCO, 0.03, share, noise=0.01)
        expected = opencv_pose(corners[board.ids], board.xy)
        found = estimate_pose(board, CAMERA, 0.03)
        np.testing.assert_allclose(found.T_cam_target, expected, atol=2e-4)


def test_the_pose_of_an_aprilgrid_is_in_kalibrs_coordinates():
    """Corner 0 at the bottom left, x to the right, y up, so that z comes out of the board;
    rows of 2 · columns corners."""
    step = np.array([0, 1, 1.3, 2.3, 2.6, 3.6, 3.9, 4.9, 5.2, 6.2]) * 0.04
    x, y = np.meshgrid(step, step[:8])
    corners = np.column_stack([x.ravel(), y.ravel(), np.zeros(80)])
    rng = np.random.default_rng(1)
    T = pose_before(rng, APRILGRID, 0.04, spread=0.1)
    board = seen_part(rng, CAMERA, T, APRILGRID, 0.04, 0.7, noise=0.01)
    found = estimate_pose(board, CAMERA, 0.04)
    np.testing.assert_allclose(found.T_cam_target, opencv_pose(corners[board.ids], board.xy), atol=2e-4)
    assert found.T_cam_target[:3, 2] @ found.T_cam_target[:3, 3] < 0  # z towards the camera
    assert found.T_cam_board[:3, 2] @ found.T_cam_board[:3, 3] > 0


def test_the_pose_of_a_puzzleboard_begins_where_its_code_does():
    rng = np.random.default_rng(2)
    target = PuzzleBoard()
    board = seen_part(rng, CAMERA, pose_before(rng, target, 0.025, spread=0.1), target, 0.025, 1, noise=0.01)
    found = estimate_pose(board, CAMERA, 0.025)
    row, column = np.divmod(board.ids, 501)
    points = np.column_stack([column, row, 0 * row]) * 0.025 @ found.T_cam_target[:3, :3].T + found.T_cam_target[:3, 3]
    assert np.abs(project(CAMERA, points) - board.xy).max() < 0.1


def test_a_plain_board_has_no_target():
    (board,), _ = random_boards(CAMERA, 0, 1)
    assert estimate_pose(board, CAMERA).T_cam_target is None


# ---- two cameras

T_RIGHT_LEFT = np.array([[0.9988, 0, -0.049, -0.12], [0, 1, 0, 0.004], [0.049, 0, 0.9988, 0.006], [0, 0, 0, 1.0]])
T_RIGHT_LEFT[:3, :3] = np.linalg.svd(T_RIGHT_LEFT[:3, :3])[0] @ np.linalg.svd(T_RIGHT_LEFT[:3, :3])[2]


def half(board, first):
    """The columns of the target's left half (`first`) or of its right one, without one that both show."""
    middle = np.median(all_places(board.target)[:, 0])
    keep = board.ij[:, 0] < middle if first else board.ij[:, 0] > middle
    return coded_board(board.target, board.ij[keep], board.xy[keep], board.image_size)


@pytest.mark.parametrize("kind", TARGETS)
def test_two_cameras_that_see_different_parts_of_a_board_are_placed_by_its_numbers(kind):
    target, side = TARGETS[kind], SIDES[kind]
    rng = np.random.default_rng(8)
    left, right = [], []
    while len(left) < 12:
        T = pose_before(rng, target, side, spread=0.15, distance=(0.4, 0.7))
        one, two = (seen_part(rng, CAMERA, M @ T, target, side, 1) for M in (np.eye(4), T_RIGHT_LEFT))
        if one is None or two is None:
            continue
        one, two = half(one, True), half(two, False)
        if min(len(one), len(two)) >= 12:
            left.append(one)
            right.append(two)
    assert not any(set(a.ids.tolist()) & set(b.ids.tolist()) for a, b in zip(left, right, strict=True))
    found = calibrate_stereo(left, right, side, model="brown")
    np.testing.assert_allclose(found.T_right_left[:3, 3], T_RIGHT_LEFT[:3, 3], atol=0.002)
    assert np.degrees(np.arccos((np.trace(found.T_right_left[:3, :3].T @ T_RIGHT_LEFT[:3, :3]) - 1) / 2)) < 0.3
    assert found.rms < 0.16
    assert sum(not v.reason for v in found.left.views) == 12


def test_half_turns_of_a_coded_board_are_no_question():
    """8 × 8 squares look the same after half a turn; their codes don't."""
    square = Charuco(8, 8, "DICT_4X4_50", 0.75)
    boards, _ = coded_boards(CAMERA, square, 0.03, seed=9, views=8, share=1)
    found = calibrate(boards, 0.03, model="brown")
    assert found.orientation == "unique"
    assert not any("half a turn" in text for text in found.advice)


# ---- the shape of a board that hardly moved


def uneven(seed):
    """Few views, each with a distortion of its own, as a shutter that rolls while the camera moves leaves it."""
    rng = np.random.default_rng(seed)
    boards = []
    while len(boards) < 8:
        T = pose_before(rng, CHARUCO, 0.03, spread=0.15, tilt=0.5, distance=(0.35, 0.6))
        board = seen_part(rng, CAMERA, T, CHARUCO, 0.03, 1)
        if board is not None:
            late = (board.xy[:, 1:] - 240) / 480
            boards.append(replace(board, xy=board.xy + late * rng.normal(0, 2, 2) + late**2 * rng.normal(0, 2, 2)))
    return boards


@pytest.mark.parametrize("seed", range(3))
def test_a_shape_that_predicts_other_pictures_worse_is_not_taken(seed):
    assert calibrate(uneven(seed), 0.03, model="brown").shape is None
