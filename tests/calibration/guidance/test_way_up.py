"""Boards are wanted upside down for half of the pictures, where their colours tell which way up they are."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration.guidance import Guide
from rcdn.calibration.guidance.guide import PATIENCE
from rcdn.calibration.guidance.way_up import LEAD, TURN, held_up, next_way, upright
from rcdn.geometry import project
from rcdn.types import SQUARES
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, detected, labels, see

BROWN = CAMERAS["brown"]


def held(T, size=SIZE, seed=0):
    """The board as detected where it stands at `T`, with noise."""
    ij, xy = see(BROWN, T, size)
    return detected(ij, xy + np.random.default_rng(seed).normal(0, 0.1, xy.shape), (640, 480), np.full(len(xy), 0.1))


def followed(views, size=SIZE):
    """(guide, boards) of `views` pictures of a board that is held as wanted."""
    guide, boards = Guide(BROWN.image_size, SPACING, size=size, model="brown"), []
    for k in range(views):
        boards.append(held(guide.progress.wanted.pose.T_cam_board, size, k))
        guide.add(boards[-1], str(k))
    return guide, boards


def still(guide, seen, start):
    """What is said of a board that is held still for half a second."""
    return [guide.look(seen, start + 0.05 * k) for k in range(11)][-1]


def test_ways_come_to_balance():
    ways, turns = [True], 0
    for _ in range(24):
        way, turn = next_way(ways)
        ways.append(way)
        turns += turn
    assert abs(ways.count(True) - ways.count(False)) <= LEAD
    assert turns <= 1 + 25 // (2 * LEAD)
    assert next_way([]) == next_way([None, None]) == (None, False)
    assert next_way([None, False] * LEAD) == (True, True)


@pytest.mark.parametrize("size", [(9, 6), (8, 5)])
def test_the_way_up_is_read_from_the_colours(size):
    across = np.array([1, 0.1]) * (labels(size) * 30.0) + [100, 80]
    boards = [detected(labels(size), xy, (640, 480)) for xy in (across, [500, 400] - across + [60, 20])]
    assert [upright(b, size) for b in boards] == [True, False]
    on_its_side = detected(labels(size), across[:, ::-1] * [-1, 1] + [600, 0], (640, 640))
    assert upright(on_its_side, size) is False
    aslant = detected(labels(size), across @ np.array([[1, 1], [-1, 1]]) + [300, 0], (640, 640))
    assert upright(aslant, size) is None
    unknown = replace(boards[0], origin_dark=None, orientation="ambiguous_180")
    assert upright(unknown, size) is None
    assert upright(boards[0], None) is None
    assert upright(detected(labels((8, 6)), labels((8, 6)) * 30.0 + 100, (640, 480)), (8, 6)) is None


def test_a_wanted_view_upside_down_covers_the_same_place():
    guide, _ = followed(1)
    wanted = guide.progress.wanted
    other = held_up(wanted, False, SQUARES, SPACING)
    assert (wanted.upright, other.upright) == (True, False)
    corners = np.array([[0, 0], [SIZE[0] - 1, 0], np.array(SIZE) - 1, [0, SIZE[1] - 1]]) * SPACING
    assert np.linalg.det(other.pose.T_cam_board[:3, :3]) == pytest.approx(1)
    camera = guide._plan.known.calibration.camera
    T = other.pose.T_cam_board
    np.testing.assert_allclose(project(camera, corners @ T[:3, :2].T + T[:3, 3]), other.outline, atol=1e-6)
    np.testing.assert_allclose(np.roll(other.outline, 2, axis=0), wanted.outline, atol=1e-6)


def test_half_of_the_pictures_show_the_board_upside_down():
    guide, _ = followed(LEAD)
    assert guide.progress.wanted.upright is False
    assert guide.progress.sentence.startswith(TURN)
    wanted = guide.progress.wanted
    same = held(held_up(replace(wanted), False, SQUARES, SPACING).pose.T_cam_board)  # turned once more: as before
    assert still(guide, same, 10.0).hint == TURN
    assert not still(guide, same, 11.0).take
    assert still(guide, held(wanted.pose.T_cam_board), 12.0).take
    guide.add(held(wanted.pose.T_cam_board), "turned")
    assert guide.progress.wanted.upright is False
    assert TURN not in guide.progress.sentence


def test_who_cannot_turn_the_board_is_not_asked_for_ever():
    guide, _ = followed(LEAD)
    same = held(held_up(guide.progress.wanted, False, SQUARES, SPACING).pose.T_cam_board)
    assert still(guide, same, 10.0).hint == TURN
    guide.look(None, 20.0)
    assert still(guide, same, 100.0).hint == TURN  # nobody was there in between
    for k in range(int(PATIENCE / 0.25)):
        guide.look(same, 101.0 + 0.25 * k)
    assert still(guide, same, 102.0 + PATIENCE).take
    guide.add(same, "not turned")
    assert guide.progress.wanted.upright is None
    assert TURN not in guide.progress.sentence


def test_boards_that_look_the_same_after_half_a_turn_stay_as_they_are():
    guide, boards = followed(LEAD + 1, (8, 6))
    assert guide.progress.wanted.upright is None
    assert all(upright(b, (8, 6)) is None for b in boards)


def test_an_upright_frame_wants_both_ways_of_a_board_on_its_side():
    """A board of 9 × 6 fits a frame of 480 × 640 px with its second index across."""
    tall = replace(BROWN, K=np.array([[520.0, 0, 236], [0, 515, 330], [0, 0, 1]]), image_size=(480, 640))
    guide = Guide(tall.image_size, SPACING, size=SIZE, model="brown")
    boards = []
    for k in range(LEAD + 1):
        wanted = guide.progress.wanted
        assert wanted.size == (6, 9)
        ij, xy = see(tall, wanted.pose.T_cam_board, (6, 9))
        turned = np.stack([8 - ij[:, 1], ij[:, 0]], axis=1)  # the labels of a board of 9 × 6, a quarter turned
        boards.append(detected(turned, xy + np.random.default_rng(k).normal(0, 0.1, xy.shape), tall.image_size))
        guide.add(boards[-1], str(k))
    ways = [upright(b, SIZE) for b in boards]
    assert ways == [ways[0]] * LEAD + [not ways[0]]
