"""One board's size and labels across views: the usual size, turned boards, parts, and mirrored labels."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration.labels import mirrored, settle, turn_labels
from rcdn.geometry.rules import CHECKER
from rcdn.types import usual_size
from rcdn_lab.camera_scenes import CAMERAS, board, labels, random_boards, random_pose, see


def grid(cols, rows, drop=()):
    ij = labels((cols, rows))
    ij = np.delete(ij, drop, axis=0)
    return board(ij, 10.0 * ij + 50, (640, 480))


def test_usual_size_counts_upright_and_turned_together():
    assert usual_size([grid(9, 6), grid(6, 9), grid(9, 6), grid(7, 5), grid(7, 5)]) == (9, 6)
    assert usual_size([grid(6, 9), grid(6, 9), grid(9, 6)]) == (6, 9)
    assert usual_size([grid(7, 5), grid(9, 6)]) == (9, 6)  # of equals the larger
    assert usual_size([grid(9, 6, drop=[3])]) is None
    assert usual_size([]) is None
    assert usual_size([grid(6, 6), grid(6, 6), grid(9, 6), grid(6, 9), grid(9, 6)]) == (9, 6)


def test_settled_turned_and_parts():
    some = settle([grid(9, 6), grid(9, 6, drop=[7]), grid(6, 9), grid(5, 4), grid(10, 3)], (9, 6), strict=False)
    assert [s.settled for s in some] == [True, True, True, False, False]
    assert not any(s.reason for s in some)
    assert sorted(map(tuple, some[2].ij)) == sorted(map(tuple, labels()))


def test_strict_refuses_what_can_not_be_part():
    good, other, long = settle([grid(5, 4), grid(7, 7), grid(10, 3)], (9, 6), strict=True)
    assert good.reason == ""
    assert "7×7" in other.reason
    assert "9×6" in other.reason
    assert "10×3" in long.reason


@pytest.mark.parametrize("size", [(9, 6), (6, 9), (8, 5), (8, 6), (7, 5)])
def test_a_turned_board_has_the_labels_of_grid_of(size):
    """The same as `Board.grid_of`, never mirrored, the square inside (0, 0) of the same colour."""
    there = grid(*size)
    (turned,) = settle([there], size[::-1], strict=True)
    assert turned.settled
    by_label = {tuple(label): spot for label, spot in zip(turned.ij.tolist(), there.xy.tolist(), strict=True)}
    expected = there.grid_of(size[::-1])
    assert all(by_label[i, j] == expected[j, i].tolist() for i, j in by_label)
    assert not mirrored(board(turned.ij, there.xy, (640, 480)))


def test_labels_that_do_not_start_at_zero_are_moved():
    shifted = board(labels((5, 4)) + np.array([3, 2]), 10.0 * labels((5, 4)) + 50, (640, 480))
    (alone,) = settle([shifted], None, strict=False)
    assert alone.ij.min(axis=0).tolist() == [0, 0]
    assert not alone.settled


@pytest.mark.parametrize(
    ("size", "orientation"),
    [
        ((9, 6), "unique"),
        ((8, 6), "ambiguous_180"),
        ((9, 7), "ambiguous_180"),
        ((7, 7), "ambiguous_180"),
        ((6, 6), "ambiguous_90"),
    ],
)
def test_orientation_is_that_of_the_conventions(size, orientation):
    assert CHECKER.orientation(*size) == orientation


@pytest.mark.parametrize("model", CAMERAS)
def test_mirrored_labels_are_known_under_every_lens(model):
    boards, _ = random_boards(CAMERAS[model], 0, 10, noise=0.5)
    for b in boards:
        assert not mirrored(b)
        assert mirrored(board(b.ij, b.xy * [-1, 1] + [639, 0], (640, 480)))


@pytest.mark.parametrize("size", [(9, 6), (6, 6), (7, 4)])
def test_quarter_turns_of_labels_come_back_after_four_and_never_mirror(size):
    T = random_pose(np.random.default_rng(1), 0.1, size=size)
    ij, xy = see(CAMERAS["pinhole"], T, size)
    for turn in range(4):
        turned = turn_labels(ij, size, turn)
        whole = size if turn % 2 == 0 else size[::-1]
        assert sorted(map(tuple, turned)) == sorted(map(tuple, labels(whole)))
        assert not mirrored(board(turned, xy, (640, 480)))
        assert np.array_equal(turn_labels(turned, whole, -turn % 4), ij)
