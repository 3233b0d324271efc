"""The ordering contract of docs/conventions.md."""

import numpy as np
import pytest
from board_scene import SIZE, View, right_handed, scene, turn, view
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.geometry.order import ordered
from rcdn.geometry.rules import CHECKER, TAGS, TRIANGLES
from rcdn.types import Board
from rcdn.types.plane import plane_points

ROLLS = [7, 97, 187, 277]


@pytest.mark.parametrize(
    ("cols", "rows", "answer"),
    [
        (9, 6, "unique"), (6, 9, "unique"), (8, 5, "unique"), (8, 6, "ambiguous_180"), (9, 7, "ambiguous_180"),
        (7, 7, "ambiguous_180"), (6, 6, "ambiguous_90"), (4, 4, "ambiguous_90"), (3, 3, "ambiguous_180"),
    ],
)  # fmt: skip
def test_orientation(cols, rows, answer):
    assert CHECKER.orientation(cols, rows) == answer


@pytest.mark.parametrize(("cols", "rows"), [(c, r) for c in range(3, 8) for r in range(3, 8)])
def test_orientation_is_the_symmetry_of_the_print(cols, rows):
    """Colours of the (cols + 1) × (rows + 1) squares, turned."""
    print_ = np.add.outer(np.arange(rows + 1), np.arange(cols + 1)) % 2
    same = [np.array_equal(np.rot90(print_, k), print_) for k in (1, 2, 3)]
    assert CHECKER.orientation(cols, rows) == (
        "ambiguous_90" if all(same) else "ambiguous_180" if same[1] else "unique"
    )


RULES = pytest.mark.parametrize("rule", [CHECKER, TAGS, TRIANGLES], ids=lambda rule: rule.pattern)


@RULES
@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    spots=st.sets(st.tuples(st.integers(-5, 5), st.integers(-5, 5)), min_size=1),
    a=st.integers(-9, 9),
    b=st.integers(-9, 9),
)
def test_turns_form_a_group_that_takes_each_step_to_the_next(rule, spots, a, b):
    ij, steps = np.array(sorted(spots)), np.array(rule.steps)
    assert np.array_equal(rule.turned(rule.turned(ij, a), b), rule.turned(ij, a + b))
    assert np.array_equal(rule.turned(ij, len(steps)), ij)
    assert np.array_equal(rule.turned(steps, 1), np.roll(steps, -1, axis=0))
    low = rule.started(ij).min(axis=0)
    assert ((low >= 0) & (low < rule.period)).all()


@RULES
def test_steps_on_the_plane_are_as_long_as_each_other_and_cells_close(rule):
    on = plane_points(rule.turned(np.array([[1, 0], [0, 0]]), 0), rule.pattern, 1.0)
    ways = plane_points(np.array(rule.steps), rule.pattern, 1.0) - plane_points(np.zeros(2), rule.pattern, 1.0)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), np.linalg.norm(on[0] - on[1]))
    angles = np.arctan2(ways[:, 1], ways[:, 0]) % (2 * np.pi)
    np.testing.assert_allclose(angles, np.arange(len(ways)) * 2 * np.pi / len(ways), atol=1e-12)
    for ring in rule.cells:
        whole = np.array([(0, 0), *ring])
        assert len(whole) == rule.sides
        assert set(map(tuple, (np.roll(whole, -1, axis=0) - whole).tolist())) <= set(rule.steps)
    assert len(rule.cells) * rule.sides == len(rule.steps)  # so many cells meet in a corner


def colour_inside(shown, found, spot=(0, 0)):
    """Grey level in the middle of the square between `spot` and its diagonal neighbour, against its right neighbour."""
    at = {tuple(s): xy for s, xy in zip(found.ij.tolist(), found.xy, strict=True)}
    i, j = spot
    middle = [np.mean([at[i + d + n, j + e] for d in (0, 1) for e in (0, 1)], axis=0) for n in (0, 1)]
    (x, y), (u, v) = np.rint(middle).astype(int)
    return int(np.sign(int(shown.grey[y, x]) - int(shown.grey[v, u])))


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("size", [(8, 5), (5, 8), (7, 4), (4, 7)])
def test_every_roll_of_an_unambiguous_board_has_the_same_labels(size, swap):
    printed = []
    for roll in ROLLS:
        shown = view(cols=size[0], rows=size[1], roll=roll, swap=swap)
        (found,) = shown.found()
        assert found.orientation == "unique"
        assert found.size == (max(size), min(size))
        assert colour_inside(shown, found) == -1
        assert right_handed(found)
        printed.append([int(n) for n in shown.number(found.xy)])
    assert all(p == printed[0] for p in printed)
    assert sorted(printed[0]) == list(range(size[0] * size[1]))


@pytest.mark.parametrize("size", [(7, 5), (6, 4), (5, 5), (4, 4), (4, 6)])
@pytest.mark.parametrize("roll", [*ROLLS, 320, 35])
def test_ambiguous_boards_are_labelled_as_they_lie(size, roll):
    shown = view(cols=size[0], rows=size[1], roll=roll)
    (found,) = shown.found()
    assert found.orientation == CHECKER.orientation(*size) != "unique"
    assert right_handed(found)
    grid = found.grid()
    along = grid[0, -1] - grid[0, 0]
    assert abs(np.arctan2(along[1], along[0])) < np.radians(46)
    assert (grid.sum(axis=2).argmin(), shown.wrong(found)) == (0, 0)


@pytest.mark.parametrize("without", ["column", "row", "corner"])
def test_a_part_follows_the_rule_for_its_box(without):
    """What was seen of an 8×5 board: 7×5 is ambiguous, 8×4 too, a missing corner changes nothing."""
    for roll in ROLLS:
        shown = view(cols=8, rows=5, roll=roll)
        gone = {"column": shown.ij[:, 0] == 0, "row": shown.ij[:, 1] == 0, "corner": (shown.ij == 0).all(axis=1)}[
            without
        ]
        (found,) = shown.found(without=np.flatnonzero(gone))
        assert len(found) == (~gone).sum()
        assert (found.ij.min(axis=0) == 0).all()
        if without == "corner":
            (whole,) = shown.found()
            assert found.orientation == "unique"
            label = dict(zip(shown.number(whole.xy).tolist(), whole.ij.tolist(), strict=True))
            assert [label[n] for n in shown.number(found.xy).tolist()] == found.ij.tolist()
        else:
            assert found.orientation == "ambiguous_180"
            step = np.linalg.lstsq(np.column_stack([found.ij, np.ones(len(found))]), found.xy, rcond=None)[0][0]
            assert step[0] > abs(step[1])


@pytest.mark.parametrize("size", [(8, 5), (6, 4), (7, 5), (5, 5), (4, 4)])
@pytest.mark.parametrize("swap", [False, True])
def test_the_colour_inside_the_origin_is_told(size, swap):
    for roll in ROLLS:
        shown = view(cols=size[0], rows=size[1], roll=roll, swap=swap)
        (found,) = shown.found()
        (part,) = shown.found(without=np.flatnonzero(shown.ij[:, 0] == 0))
        for each in (found, part):
            assert each.origin_dark is (colour_inside(shown, each) == -1)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(3, 8), st.integers(3, 8), st.floats(0, 360), st.integers(0, 3), st.tuples(*[st.integers(-4, 4)] * 2))
def test_labels_dont_depend_on_the_labels_before(cols, rows, roll, quarters, shift):
    """Whatever right-handed labels the flood fill gave, the contract's are the same."""
    ij = np.array([(i, j) for j in range(rows) for i in range(cols)])
    cos, sin = np.cos(np.radians(roll + 0.123)), np.sin(np.radians(roll + 0.123))
    xy = ij @ np.array([[cos, sin], [-sin, cos]]) * 20
    first = ordered(ij, xy, -1)
    other = turn(ij, quarters)
    middle = turn(np.array([[1, 1]]), quarters)[0]  # twice the centre of the square that is dark
    low = (middle - 1) // 2
    again = ordered(other + shift, xy, -1 if (low.sum() + sum(shift)) % 2 == 0 else 1)
    assert np.array_equal(first, again)


@pytest.mark.parametrize("roll", ROLLS)
def test_corners_come_row_by_row(roll):
    (found,) = view(cols=8, rows=5, roll=roll).found()
    assert found.ij.tolist() == [[i, j] for j in range(5) for i in range(8)]


@pytest.mark.parametrize("size", [(6, 5), (5, 4), (8, 5), (7, 6)])
def test_a_quarter_turn_to_the_users_size_keeps_the_dark_square(size):
    """`Board.grid_of` with columns and rows swapped, as some people count."""
    shown = view(cols=size[0], rows=size[1], roll=50)
    (found,) = shown.found()
    grid = found.grid_of(size[::-1])
    assert grid.shape == (*size, 2)
    ij = [(i, j) for j in range(size[0]) for i in range(size[1])]
    flipped = Board(grid.reshape(-1, 2), ij, SIZE, np.ones(len(ij)), np.zeros(len(ij)), "unique")
    assert right_handed(flipped)
    assert colour_inside(shown, flipped) == colour_inside(shown, found) == -1


def test_a_board_seen_from_both_cameras_of_a_rig_has_one_labelling():
    """The point of the rule: the same printed corner, though the views are rolled by 120°."""
    labels = []
    for roll, tilt in ((0, 20), (120, 35)):
        shown = View(scene(9, 6, 28, roll, tilt))
        (found,) = shown.found()
        labels.append(dict(zip(shown.number(found.xy).tolist(), found.ij.tolist(), strict=True)))
    assert labels[0] == labels[1]
