"""Completion: what it may take, and what it must leave."""

import numpy as np
import pytest
from board_scene import VIEWS, clutter, view
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards.graph import cells, label, links
from rcdn.boards.grow import board_sign, grow
from rcdn.boards.local import Grid
from rcdn.boards.validate import prune
from rcdn.types import Status


def started(shown, core, **changes):
    """Field and Grid of the corners whose printed labels are in `core`, and the corners' numbers."""
    field, number = shown.field(**changes)
    at = {tuple(shown.ij[n]): k for k, n in enumerate(number) if n >= 0}
    return field, Grid({s: at[s] for s in core if s in at}, field.xy), number


def block(u, v, cols, rows):
    return [(u + i, v + j) for j in range(rows) for i in range(cols)]


def but_for(shown, hole):
    return [tuple(s) for n, s in enumerate(shown.ij.tolist()) if n != hole]


def grown(field, grid):
    free = np.ones(len(field.xy), bool)
    free[list(grid.at.values())] = False
    grow(field, grid, free)
    return free


@pytest.mark.parametrize("name", VIEWS)
def test_a_core_grows_to_the_whole_board(name):
    """From 3×3 strong corners, with all others weak."""
    shown = view(name)
    core = block(2, 1, 3, 3)
    weak = [n for n, s in enumerate(shown.ij.tolist()) if tuple(s) not in core]
    field, grid, number = started(shown, core, weak=weak)
    assert len(grid) == 9
    free = grown(field, grid)
    assert {s: int(number[k]) for s, k in grid.at.items()} == {tuple(s): n for n, s in enumerate(shown.ij.tolist())}
    assert not free.any()


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.data())
def test_grow_neither_drops_nor_renames_nor_takes_twice(data):
    shown = view("tilted")
    every = [tuple(s) for s in shown.ij.tolist()]
    core = sorted(set(block(2, 1, 2, 2)) | data.draw(st.sets(st.sampled_from(every))))
    gone = data.draw(st.sets(st.sampled_from(range(len(every))), max_size=6))
    extra = clutter(shown, 30, data.draw(st.integers(0, 1000)), apart=10)
    field, grid, number = started(shown, core, without=[n for n in gone if every[n] not in core], extra=extra)
    before = dict(grid.at)
    free = grown(field, grid)
    assert before.items() <= grid.at.items()
    corners = list(grid.at.values())
    assert len(set(corners)) == len(corners)
    assert not free[corners].any()
    prune(grid, field)
    for spot, corner in grid.at.items():
        assert number[corner] >= 0
        assert tuple(shown.ij[number[corner]]) == spot


def test_a_hole_is_filled_and_said_so():
    shown = view("tilted")
    holes = [shown.index(3, 2), shown.index(1, 1), shown.index(6, 4), shown.index(0, 2)]
    (found,) = shown.found(weak=holes)
    assert found.complete
    assert shown.wrong(found) == 0
    completed = shown.number(found.xy)[found.status == Status.COMPLETED]
    assert sorted(completed) == sorted(holes)


def test_grow_leaves_a_hole_without_a_candidate():
    shown = view("tilted")
    hole = shown.index(3, 2)
    field, grid, _ = started(shown, but_for(shown, hole), without=[hole])
    grown(field, grid)
    assert (3, 2) not in grid.at


@pytest.mark.parametrize("step", [(0.45, 0), (-0.3, 0.35), (0, 0.5)])
def test_a_weak_corner_away_from_its_prediction_is_left(step):
    shown = view("flat")
    hole = shown.index(3, 2)
    field, grid, _ = started(shown, but_for(shown, hole), weak=[hole], moved={hole: np.array(step) * 30})
    grown(field, grid)
    assert (3, 2) not in grid.at


def test_bent_axes_dont_matter_where_all_edges_are_seen():
    """Motion blur turns the axes of a corner; what lies between the corners stays."""
    shown = view("flat")
    hole = shown.index(3, 2)
    field, grid, number = started(shown, but_for(shown, hole), weak=[hole])
    field.axes[number == hole] += 0.7
    grown(field, grid)
    assert number[grid.at[3, 2]] == hole


def test_a_weak_corner_without_edges_to_its_neighbours_is_left():
    shown = view("flat")
    hole = shown.index(3, 2)
    field, grid, _ = started(shown, but_for(shown, hole), weak=[hole])
    x, y = np.rint(shown.xy[hole]).astype(int)
    field.grey.setflags(write=True)
    before = field.grey.copy()
    try:
        field.grey[y - 28 : y + 29, x - 28 : x + 29] = 128
        grown(field, grid)
    finally:
        field.grey[:] = before
    assert (3, 2) not in grid.at


@pytest.mark.parametrize("name", VIEWS)
def test_board_sign_is_what_is_printed(name):
    """+1: the square between (0, 0) and (1, 1) is bright. `sheet` prints it dark unless `swap`."""
    shown = view(name)
    field, number = shown.field()
    grid = Grid({tuple(shown.ij[n]): k for k, n in enumerate(number)}, field.xy)
    assert board_sign(field, grid) == (1 if name == "negative" else -1)
    shifted = Grid({(u + 1, v): k for (u, v), k in grid.at.items()}, field.xy)
    assert board_sign(field, shifted) == -board_sign(field, grid)


def test_board_sign_of_nothing():
    field, _ = view("flat").field()
    assert board_sign(field, Grid({}, field.xy)) == 0


def test_the_graph_alone_finds_what_it_should_here():
    """So that the tests above test `grow`: without completion, weak corners are missing."""
    shown = view("flat")
    weak = [n for n, s in enumerate(shown.ij.tolist()) if tuple(s) not in block(2, 1, 3, 3)]
    field, _ = shown.field(weak=weak)
    (grid,) = label(field, cells(field, links(field)))
    assert len(grid) == 9
