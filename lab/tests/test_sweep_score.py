"""Scores of detections whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.synthetic import BoardTruth
from rcdn_lab.peers import Grid
from rcdn_lab.sweep.score import Answers, broken, row, score

IJ = np.array([[i, j] for j in range(4) for i in range(5)])
PITCH = 20.0


def board(x=50.0, **changes):
    """A face-on board of 5 × 4 corners, all of them visible."""
    known = BoardTruth(IJ * PITCH + x, IJ, np.ones(20, bool), np.zeros(20, bool), np.full(20, PITCH))
    return replace(known, **changes)


def answers(*boards):
    return Answers(boards, [np.full(len(b.xy), 0.1) for b in boards])


ONE = answers(board())
XY = board().xy


def shifted(dx):
    return XY + np.array([dx, 0])


def test_a_perfect_detector():
    done = score([Grid(shifted(0.1), IJ)], ONE)
    assert (done.success, done.hits, done.wrong, done.mislabelled, done.false) == (True, 20, 0, 0, 0)
    figures = row([done])
    assert (figures["success"], figures["recall"], figures["mean px"], figures["ratio"]) == (1, 1, 0.1, 1)
    assert figures["z"] is None


@pytest.mark.parametrize(
    "label",
    [
        IJ + np.array([3, -2]),
        np.column_stack([-IJ[:, 1], IJ[:, 0]]),
        np.column_stack([-IJ[:, 0], -IJ[:, 1]]),
        IJ[:, ::-1],
    ],
    ids=["shifted", "quarter turn", "half turn", "mirrored"],
)
def test_labels_count_up_to_a_symmetry(label):
    assert score([Grid(XY, label)], ONE).success


def test_two_swapped_labels_are_wrong():
    label = IJ.copy()
    label[[3, 4]] = label[[4, 3]]
    done = score([Grid(XY, label)], ONE)
    assert (done.success, done.mislabelled, done.hits) == (False, 1, 20)


def test_a_row_skipped_is_wrong():
    label = IJ + (IJ[:, 1:] > 1) * np.array([0, 1])
    assert score([Grid(XY, label)], ONE).mislabelled == 1


def test_what_is_missing_and_what_is_too_much():
    assert not score([Grid(XY[:-1], IJ[:-1])], ONE).success
    extra = score([Grid(np.vstack([XY, [[300, 20]]]), np.vstack([IJ, [[9, 9]]]))], ONE)
    assert (extra.success, extra.wrong, extra.hits) == (False, 1, 20)
    nothing = score([], ONE)
    assert (nothing.success, nothing.hits, row([nothing])["recall"]) == (False, 0, 0)


def test_a_board_in_two_pieces_or_twice_is_no_success():
    halves = IJ[:, 0] < 2
    pieces = score([Grid(XY[halves], IJ[halves]), Grid(XY[~halves], IJ[~halves])], ONE)
    assert (pieces.success, pieces.hits, pieces.mislabelled) == (False, 20, 0)
    twice = score([Grid(XY, IJ), Grid(XY, IJ)], ONE)
    assert (twice.success, twice.hits, twice.false) == (False, 20, 0)
    assert not score([Grid(XY, IJ), Grid(XY, IJ)], answers(board(), board(x=300))).success


def test_two_boards():
    both = answers(board(), board(x=300))
    assert score([Grid(XY + 250, IJ), Grid(XY, IJ + 7)], both).success
    assert not score([Grid(XY, IJ)], both).success
    mixed = score([Grid(np.vstack([XY, XY + 250]), np.vstack([IJ, IJ + np.array([5, 0])]))], both)
    assert (mixed.success, mixed.mislabelled, mixed.hits) == (False, 1, 40)


def test_a_board_where_none_is():
    done = score([Grid(XY, IJ)], answers())
    assert (done.success, done.false, done.wrong, done.corners) == (False, 1, 20, 0)
    assert score([], answers()).success
    figures = row([done, score([], answers())])
    assert (figures["success"], figures["recall"], figures["mean px"], figures["false"]) == (0.5, None, None, 1)


def test_ignored_corners_are_neither_demanded_nor_forbidden():
    doubtful = IJ[:, 0] == 4
    known = answers(board(visible=~doubtful, ignore=doubtful))
    assert score([Grid(XY, IJ)], known).success
    assert score([Grid(XY[~doubtful], IJ[~doubtful])], known).success
    some = score([Grid(XY[1:], IJ[1:])], known)
    assert (some.success, some.wrong, some.hits) == (False, 0, 15)


def test_a_hit_lies_within_a_share_of_the_square():
    near, far = (score([Grid(shifted(d), IJ)], ONE) for d in (3.9, 4.1))
    assert (near.hits, far.hits, far.wrong) == (20, 0, 20)
    small = answers(board(pitch=np.full(20, 6.0)))
    assert score([Grid(shifted(2.0), IJ)], small).hits == 20
    assert score([Grid(shifted(2.2), IJ)], small).hits == 0


def test_raw_corners_are_no_success():
    done = score([Grid(np.vstack([XY, [[300, 20]]]))], ONE, raw=True)
    assert (done.success, done.hits, done.wrong) == (None, 20, 1)
    figures = row([done])
    assert (figures["success"], figures["mislabelled"], figures["false"]) == (None, None, None)


def test_honest_sigma():
    rng = np.random.default_rng(0)
    sigma = rng.uniform(0.05, 0.3, 20)
    scores = [score([Grid(XY + rng.normal(0, 1, (20, 2)) * sigma[:, None], IJ, sigma)], ONE) for _ in range(100)]
    assert row(scores)["z"] == pytest.approx(1, abs=0.05)


def test_corners_that_tell_nothing_do_not_count_against_the_bound():
    known = Answers([board()], [np.append(np.full(19, 0.1), np.inf)])
    assert row([score([Grid(shifted(0.2), IJ)], known)])["ratio"] == 2


def test_breaking_down_is_no_success_even_where_nothing_is():
    for known in (answers(), ONE):
        done = broken(known, False, "#3 ValueError: x")
        assert (done.success, done.hits, done.wrong) == (False, 0, 0)
    assert row([done])["first failure"] == "#3 ValueError: x"
    assert broken(ONE, True, "x").success is None
