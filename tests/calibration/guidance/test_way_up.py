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
    turned = [b for b in boards if b.ij[0].tolist() == [0, 0]]
    assert len(turned) == 2  # their own labels begin at (0, 0), wherever it lies
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
    for view in (wanted, other):
        T = view.pose.T_cam_board
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
        np.testing.assert_allclose(project(BROWN, corners @ T[:3, :2].T + T[:3, 3]).shape, (4, 2))
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
    assert still(guide, same, 10.0 + PATIENCE - 1).hint == TURN
    assert still(guide, same, 11.0 + PATIENCE).take
    guide.add(same, "not turned")
    assert guide.progress.wanted.upright is None
    assert TURN not in guide.progress.sentence


def test_boards_that_look_the_same_after_half_a_turn_stay_as_they_are():
    guide, boards = followed(LEAD + 1, (8, 6))
    assert guide.progress.wanted.upright is None
    assert not any(upright(b, (8, 6)) for b in boards)
