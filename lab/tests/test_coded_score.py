"""Numbers of corners against truth: what is right, wrong, missing and of another kind, constructed."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.types import AprilGrid, Charuco, PuzzleBoard
from rcdn_lab.coded.score import Count, TrueBoard, same_print, score
from rcdn_lab.peers.coded import Labelled

BOARD = Charuco(5, 4, "DICT_4X4_50", 0.75)
IJ = np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)
TRUE = TrueBoard(BOARD, np.arange(12), 100.0 + 20 * IJ, np.ones(12, bool))


def found(ids=TRUE.ids, xy=TRUE.xy, target=BOARD):
    return Labelled(np.asarray(ids), np.asarray(xy, float), target)


def figures(*boards, true=(TRUE,)):
    count = score(boards, true)
    return count.named, count.complete, count.right, count.wrong, count.other


def test_all_right():
    assert score([found()], [TRUE]) == Count(1, 1, 1, 1, 12, 12)
    assert score([found()], [TRUE]).recall == 1


def test_nothing_found_is_missing_and_not_wrong():
    assert figures() == (0, 0, 0, 0, 0)
    assert score([], [TRUE]).recall == 0


def test_a_number_elsewhere_is_wrong():
    swapped = TRUE.ids.copy()
    swapped[[3, 4]] = [4, 3]
    assert figures(found(swapped)) == (1, 0, 10, 2, 0)


def test_corners_count_within_their_reach():
    near, far = ([[3.9, 0]], [[4.1, 0]])
    assert figures(found(xy=TRUE.xy + near)) == (1, 1, 12, 0, 0)
    assert figures(found(xy=TRUE.xy + far)) == (0, 0, 0, 12, 0)
    small = replace(TRUE, xy=TRUE.xy / 4)  # 5 px apart: 1.75 px reach
    assert figures(found(xy=small.xy + np.array([2.0, 0.0])), true=(small,))[3] == 12


def test_numbers_that_the_board_lacks_are_wrong_if_it_is_known_whole():
    ids, xy = np.append(TRUE.ids, 99), np.vstack([TRUE.xy, [[500, 500]]])
    assert figures(found(ids, xy)) == (1, 1, 12, 1, 0)
    part = replace(TRUE, whole=False)
    assert figures(found(ids, xy), true=(part,)) == (1, 1, 12, 0, 0)
    on_a_corner = np.vstack([TRUE.xy, TRUE.xy[:1]])
    assert figures(found(ids, on_a_corner), true=(part,)) == (1, 1, 12, 1, 0)


def test_every_number_is_wrong_where_there_is_no_board():
    assert figures(found(), true=()) == (0, 0, 0, 12, 0)


def test_corners_that_are_not_demanded_count_neither_way_unless_they_are_wrong():
    part = replace(TRUE, demanded=TRUE.ids < 6)
    assert score([found()], [part]) == Count(1, 1, 1, 1, 6, 6)
    assert score([found(TRUE.ids[:6], TRUE.xy[:6])], [part]) == Count(1, 1, 1, 1, 6, 6)
    assert score([found(xy=np.where(TRUE.ids[:, None] < 6, TRUE.xy, TRUE.xy + 9))], [part]).wrong == 6
    # at the rim of a cover a corner may be damaged, and its number right
    assert score([found(xy=np.where(TRUE.ids[:, None] < 6, TRUE.xy, TRUE.xy + 5))], [part]).wrong == 0
    assert score([found(xy=TRUE.xy + 5)], [part]).wrong == 6


def test_corners_that_the_picture_cannot_show_are_wrong_when_they_are_claimed():
    partial = replace(TRUE, xy=np.where(TRUE.ids[:, None] < 8, TRUE.xy, np.nan), demanded=TRUE.ids < 8)
    assert score([found(TRUE.ids[:8], TRUE.xy[:8])], [partial]) == Count(1, 1, 1, 1, 8, 8)
    assert score([found()], [partial]).wrong == 4


def test_a_corner_found_twice_is_one():
    assert score([found(), found()], [TRUE]).right == 12


def test_boards_of_one_kind_are_told_apart_by_place():
    other = replace(TRUE, xy=TRUE.xy + 200)
    assert figures(found(), found(xy=other.xy), true=(TRUE, other)) == (2, 2, 24, 0, 0)
    assert figures(found(xy=other.xy), true=(TRUE, other)) == (1, 1, 12, 0, 0)


@pytest.mark.parametrize(
    "change",
    [{"legacy": True}, {"inverted": True}, {"dictionary": "DICT_5X5_50"}, {"dictionary": "DICT_APRILTAG_36h10"}],
    ids=str,
)
def test_boards_of_another_kind_are_not_named(change):
    assert figures(found(target=replace(BOARD, **change))) == (0, 1, 12, 0, 1)


def test_prints_that_are_the_same():
    assert same_print(replace(BOARD, dictionary="DICT_4X4_1000", rows=None), BOARD)
    assert same_print(AprilGrid(6, None, "tag36h11", 0.31), AprilGrid(6, 6, "tag36h11", 0.3))
    assert not same_print(AprilGrid(6, 6, "tag36h10", 0.3), AprilGrid(6, 6, "tag36h11", 0.3))
    assert not same_print(BOARD, PuzzleBoard())
    assert not same_print(
        replace(BOARD, dictionary="DICT_APRILTAG_36h10"), replace(BOARD, dictionary="DICT_APRILTAG_36h11")
    )


def test_readers_that_are_told_name_what_they_read():
    assert figures(found(target=None)) == (1, 1, 12, 0, 0)


def test_counts_add_up():
    assert Count(1, 1, 1, 0, 12, 6) + Count(1, 2, 0, 1, 8, 4) == Count(2, 3, 1, 1, 20, 10)
    assert (Count(corners=12, right=6) + Count(corners=8, right=4)).recall == 0.5
    assert Count().recall is None
