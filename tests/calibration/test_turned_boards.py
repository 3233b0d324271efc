"""Boards whose labels are told up to turns only: square ones of an odd number of corners, turned by a quarter between
pictures or cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate, calibrate_rig, calibrate_stereo, estimate_rig_pose
from rcdn.geometry import project, rotation
from rcdn.geometry.order import colour_after, turn_labels, turn_of
from rcdn.geometry.part import common_colour, labels_of
from rcdn.geometry.rigid import motion
from rcdn.geometry.rules import CHECKER
from rcdn.types import Board, Camera, Pose, Rig, Status

SPACING, NOISE = 0.03, 0.05
CAMERA = Camera(np.array([[800, 0, 640], [0, 800, 480], [0, 0, 1.0]]), np.array([-0.1, 0.02, 0, 0, 0]), (1280, 960))
SIZES = [(9, 6), (8, 6), (7, 7), (6, 6)]


def seen(T, size, rng, bend=0.0):
    """The board as a detector finds it at T_cam_board: labels by how it lies and by its colours. `bend`: m that its
    outer columns lie behind the middle one."""
    columns, rows = size
    ij = np.array([(i, j) for j in range(rows) for i in range(columns)])
    points = np.column_stack([ij * SPACING, bend * (2 * ij[:, 0] / (columns - 1) - 1) ** 2])
    xy = project(CAMERA, points @ T[:3, :3].T + T[:3, 3]) + rng.normal(0, NOISE, (len(ij), 2))
    turn = turn_of(ij, xy, -1)
    labels = CHECKER.started(CHECKER.turned(ij, turn))
    order = np.lexsort((labels[:, 0], labels[:, 1]))
    orientation = CHECKER.orientation(*(labels.max(axis=0) + 1).tolist())
    return Board(
        xy[order], labels[order].astype(int), CAMERA.image_size, np.ones(len(ij)),
        np.full(len(ij), Status.REFINED), orientation, sigma=np.full(len(ij), NOISE),
        origin_dark=bool(colour_after(ij, -1, turn) < 0),
    )  # fmt: skip


def rolled(quarters):
    """T_right_left of a right camera that is rolled by quarter turns."""
    roll = rotation(np.array([0, 0, np.pi / 2 * quarters]))
    return motion(roll @ rotation(np.array([0, -0.2, 0])), roll @ np.array([-0.3, 0.02, 0.05]))


def moments(T_right_left, size, rng, count=12):
    """The boards of both cameras at `count` moments."""
    out = []
    for _ in range(count):
        where = [rng.uniform(-0.25, 0.1), rng.uniform(-0.25, 0.02), rng.uniform(0.8, 1.2)]
        T = motion(rotation(rng.uniform(-0.4, 0.4, 3) * [1, 1, 0.3]), np.array(where))
        out.append((seen(T, size, rng), seen(T_right_left @ T, size, rng)))
    return [list(side) for side in zip(*out, strict=True)]


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
@pytest.mark.parametrize("size", SIZES)
def test_two_cameras_are_placed_however_one_of_them_is_rolled(size, quarters):
    T = rolled(quarters)
    left, right = moments(T, size, np.random.default_rng(1))
    found = calibrate_stereo(left, right, SPACING, cameras=(CAMERA, CAMERA))
    assert np.abs(found.T_right_left - T).max() < 0.001


def test_they_are_with_lenses_that_are_solved_for():
    T = rolled(1)
    left, right = moments(T, (7, 7), np.random.default_rng(1))
    found = calibrate_stereo(left, right, SPACING, model="brown")
    assert np.abs(found.T_right_left - T).max() < 0.005


def test_both_pictures_are_seen_whole_once_rectified_where_one_is_smaller():
    """Of half the size, from the same lens: it fills the rectified picture as one of the full size does."""
    T = rolled(0)
    left, right = moments(T, (9, 6), np.random.default_rng(4))
    small = [replace(b, xy=(b.xy + 0.5) / 2 - 0.5, sigma=b.sigma / 2, image_size=(640, 480)) for b in right]
    both, halved = (calibrate_stereo(left, r, SPACING, model="brown") for r in (right, small))
    for P in (halved.P_left, halved.P_right):
        assert P[:, :3] == pytest.approx(both.P_left[:, :3], rel=0.02)


def test_cameras_of_a_rig_are_too():
    T = rolled(1)
    left, right = moments(T, (7, 7), np.random.default_rng(2))
    assert {b.origin_dark for b in left} != {b.origin_dark for b in right}
    found, _ = calibrate_rig({"a": left, "b": right}, SPACING, model="brown").rig.relative("a", "b")
    assert np.abs(found - T).max() < 0.005


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_rolled_camera_of_a_rig_counts_for_the_pose(size, quarters, coloured):
    """Also of boards whose colours weren't kept."""
    T = rolled(quarters)
    rig = Rig(("a", "b"), (CAMERA, CAMERA), (Pose(np.eye(4)), Pose(T)))
    where = motion(rotation(np.array([0.2, -0.1, 0.05])), np.array([-0.15, -0.1, 1.0]))
    rng = np.random.default_rng(3)
    boards = {"a": seen(where, size, rng), "b": seen(T @ where, size, rng)}
    boards = boards if coloured else {n: replace(b, origin_dark=None) for n, b in boards.items()}
    found = estimate_rig_pose(boards, rig, SPACING)
    assert not found.left_out
    middle = np.array([*(np.array(size) - 1) / 2 * SPACING, 0, 1])  # where it is whatever half turn the labels have
    assert found.T_rig_board @ middle == pytest.approx(where @ middle, abs=0.001)


def test_pictures_turned_by_a_quarter_share_the_shape_of_a_bent_square_board():
    rng, boards = np.random.default_rng(3), []
    middle = np.array([3, 3, 0]) * SPACING
    for k in range(24):
        turn = rotation(np.array([0, 0, np.pi / 2 * (k % 2)])) @ rotation(rng.uniform(-0.6, 0.6, 3) * [1, 1, 0.3])
        at = np.array([*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.45, 0.7)])
        boards.append(seen(motion(turn, at - turn @ middle), (7, 7), rng, bend=0.002))
    assert {b.origin_dark for b in boards} == {True, False}
    found = calibrate(boards, SPACING, model="brown")
    assert found.rms < 1.3 * NOISE * np.sqrt(2)  # .42 px if shapes were mixed
    assert np.abs(found.camera.parameters[:4] - CAMERA.parameters[:4]).max() < 1.5


def test_labels_of_a_square_board_are_those_of_its_colours():
    board = seen(motion(np.eye(3), np.array([-0.1, -0.1, 0.6])), (7, 7), np.random.default_rng(0))
    other = Board(
        board.xy, turn_labels(board.ij, board.size, 1), board.image_size, board.response, board.status,
        "ambiguous_180", origin_dark=not board.origin_dark,
    )  # fmt: skip
    dark = common_colour([board, other], (7, 7))
    assert dark is True
    a, b = labels_of(board, (7, 7), dark), labels_of(other, (7, 7), dark)
    assert any(np.array_equal(a, turned) for turned in (b, 6 - b))
    assert not np.array_equal(other.ij, board.ij)
    assert common_colour([], (7, 7)) is None
    assert np.array_equal(labels_of(other, (7, 7), None), other.ij)
