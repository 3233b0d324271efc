"""One board's size and labels across views: the usual size, turned boards, parts, and mirrored labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration.coded import Geometries
from rcdn.calibration.labels import label_of, mirrored
from rcdn.geometry import project
from rcdn.geometry.matrices import affine
from rcdn.geometry.order import turn_labels
from rcdn.geometry.part import common_colour
from rcdn.geometry.rules import CHECKER
from rcdn.types import usual_size
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, detected, labels, random_boards, random_pose, see


def settle(boards, size, strict, dark=None):
    """The labels of `boards` on the whole board, whose colour they tell unless `dark` does."""
    dark = common_colour(boards, size) if dark is None else dark
    return [label_of(b, size, strict, dark) for b in boards]


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


# ---- parts that the border cut


def parts_of(size, model, many=40, seed=3):
    """(board as detected, labels of its corners on the whole board as that would be labelled where it lies) of parts
    that the picture's border left."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < many:
        T = random_pose(rng, spread=0.9, tilt=0.6, distance=(0.2, 0.4), size=size)
        ij, xy = see(CAMERAS[model], T, size)
        if len(ij) < 20 or sorted(np.ptp(ij, axis=0) + 1) == sorted(size):
            continue
        on_board = np.column_stack([labels(size) * SPACING, 0 * labels(size)[:, 0]])
        every = project(CAMERAS[model], on_board @ T[:3, :3].T + T[:3, 3])
        whole = detected(labels(size), every, (640, 480))
        (label,) = settle([whole], size, strict=True)
        at = {tuple(p): label for p, label in zip(whole.xy.round(6).tolist(), label.ij, strict=True)}
        part = detected(ij, xy, (640, 480))
        slope = affine(whole.ij, whole.xy)[:, 0]
        if 0.5 < abs(slope[0]) / np.linalg.norm(slope) < 0.87:
            continue  # nearly as much on its side as not
        found.append((part, np.array([at[tuple(p)] for p in part.xy.round(6).tolist()])))
    return found


@pytest.mark.parametrize("model", ["pinhole", "brown"])
@pytest.mark.parametrize("size", [(9, 6), (8, 5), (8, 6), (9, 7)])
def test_a_part_that_the_border_cut_gets_its_place(size, model):
    """Never a wrong one; of a board that looks the same after half a turn, the one that the whole board would have."""
    parts = parts_of(size, model)
    placed = 0
    for part, true in parts:
        (label,) = settle([part], size, strict=True, dark=True)
        if label.settled:
            placed += 1
            assert np.array_equal(label.ij, true)
    assert placed >= (0.65 if size == (8, 6) else 0.75) * len(parts)


def cut_by_the_right_border(size=(9, 6), seen=6):
    """The first `seen` columns of a board, the others being beyond the border."""
    ij = labels((seen, size[1]))
    return detected(ij, 40.0 * ij + [640 - 40 * seen + 20, 100], (640, 480))


def test_colours_tell_which_half_turn_is_right():
    part = cut_by_the_right_border()
    assert part.orientation == "ambiguous_90"
    (label,) = settle([part], (9, 6), strict=False)
    assert label.settled
    assert (label.ij - part.ij == 0).all()
    (other,) = settle([replace(part, origin_dark=not part.origin_dark)], (9, 6), strict=False)
    assert other.settled
    assert sorted(map(tuple, other.ij.tolist())) == [(i, j) for i in range(3, 9) for j in range(6)]
    (unknown,) = settle([replace(part, origin_dark=None)], (9, 6), strict=False)
    assert not unknown.settled


def test_a_part_without_one_place_stays_open():
    part = cut_by_the_right_border()
    inside = replace(part, xy=part.xy - [200, 0])  # both ends are seen: another board, or a cover
    both = detected(labels((16, 6)), 40.0 * labels((16, 6)) + [20, 100], (640, 480))
    covered = detected(*(a[~((part.ij >= 2) & (part.ij <= 3)).all(axis=1)] for a in (part.ij, part.xy)), (640, 480))
    for each, size in ((inside, (9, 6)), (both, (20, 6)), (covered, (9, 6))):
        (label,) = settle([each], size, strict=False)
        assert not label.settled
    (whole,) = settle([both], (16, 6), strict=False)
    assert whole.settled


@pytest.mark.parametrize("size", [(8, 6), (9, 7)])
def test_a_place_that_the_colours_contradict_is_refused(size):
    """A board that lies in the frame, its last column near the border, with its first one covered."""
    ij = labels((size[0] - 1, size[1]))
    at = 40.0 * ij + [640 - 40 * (size[0] - 1) + 20, 100]
    assert settle([detected(ij, at, (640, 480))], size, strict=False, dark=True)[0].settled
    assert not settle([detected(ij + np.array([[1, 0]]), at, (640, 480))], size, strict=False, dark=True)[0].settled


def test_nothing_is_placed_without_colours_or_where_such_a_board_is_seen_whole():
    part = cut_by_the_right_border()
    even = detected(labels((7, 6)), 40.0 * labels((7, 6)) + [640 - 40 * 7 + 20, 100], (640, 480))
    assert settle([even], (8, 6), strict=False, dark=True)[0].settled
    assert not settle([even], (8, 6), strict=False)[0].settled
    whole = [detected(labels(), 30.0 * labels() + [100 + k, 100], (640, 480)) for k in range(3)]
    small = detected(labels((6, 6)), 30.0 * labels((6, 6)) + 100, (640, 480))
    for more, settled in (([], True), ([small], False)):
        boards = [*whole, part, *more]
        assert Geometries.of(boards, 0.03).labelled(boards, False)[3].settled is settled


def test_a_transposed_size_turns_parts_as_whole_boards():
    """Boards that look the same after half a turn, held nearly upright, by the size that was given the other way
    round."""
    for roll in (-0.05, 0.05):
        turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
        ij = labels((8, 6))
        xy = 40.0 * ij @ turn.T + [408, 100]
        whole = detected(ij, xy - [300, 0], (640, 480))
        seen = (xy[:, 0] < 630) & (ij[:, 0] < 6)
        part = detected(ij[seen], xy[seen], (640, 480))
        assert part.size == (6, 6)
        labelled = settle([whole, part], (6, 8), strict=False)
        assert [a.settled for a in labelled] == [True, True]
        ways = [
            np.sign(np.linalg.lstsq(np.column_stack([a.ij, np.ones(len(a.ij))]), b.xy, rcond=None)[0][0, 1])
            for a, b in zip(labelled, (whole, part), strict=True)
        ]
        assert ways[0] == ways[1]
