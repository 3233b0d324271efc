"""OCPAD: parts of boards on rendered scenes with exact truth, and its match of graphs with known labels."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn_lab.peers import PEERS
from rcdn_lab.peers.ocpad import is_even, largest_component, part_of, quadrangles_only
from rcdn_lab.peers.rochade_graph import EdgeGraph
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import BASE

FIND = PEERS["ocpad"].load()
SIZE = (9, 6)
WHOLE = {"clean": {"noise": 0.0, "tilt": 5.0}, "tilt": {"tilt": 45.0}, "barrel": {"barrel": 1.5}, "blur": {"blur": 3.0}}
PARTS = {"quadrant": ({"cover": "quadrant"}, 36), "bar": ({"cover": "bar"}, 20), "cut": ({"cut": 0.33}, 30)}


def judged(made, size=SIZE):
    return score(FIND(made.image, size), Answers(made.boards, [np.ones(len(b.xy)) for b in made.boards]))


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("seed", range(2))
def test_whole_boards_with_right_labels(name, seed):
    done = judged(picture(replace(BASE, **WHOLE[name]), [31, seed], SIZE))
    assert done.success
    assert done.gap.mean() < 0.1


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("seed", range(3))
def test_parts_with_right_labels(name, seed):
    """Of a board that a bar divides, the larger part."""
    change, least = PARTS[name]
    done = judged(picture(replace(BASE, **change), [31, seed], SIZE))
    assert done.mislabelled == 0
    assert done.hits >= least
    assert done.gap.mean() < 0.15


@pytest.mark.parametrize("kind", ["plain", "noise", "shapes", "text"])
def test_no_board_in_clutter(kind):
    assert FIND(picture(replace(BASE, boards=0, clutter=kind), [35, 0], SIZE).image, SIZE) == []


def lattice_graph(cols, rows, drop=(), cut=()):
    """A graph of a tilted lattice without the places `drop` and the links `cut`, shuffled; and the places."""
    ij = [(i, j) for j in range(rows) for i in range(cols) if (i, j) not in drop]
    np.random.default_rng(0).shuffle(ij)
    number = {tuple(spot): k for k, spot in enumerate(ij)}
    links = [
        sorted((number[i, j], number[i + d, j + e]))
        for i, j in number
        for d, e in ((1, 0), (0, 1))
        if (i + d, j + e) in number and ((i, j), (i + d, j + e)) not in cut
    ]
    u = np.array(ij, float)
    return EdgeGraph(u @ [[22.0, 7.0], [-13.0, 16.0]] / (1 + 0.01 * u[:, :1]) + 300, np.array(links)), np.array(ij)


def places(graph, ij, size):
    """Place on the board and true place of each matched vertex, row by row."""
    xy = part_of(graph, size)
    at = np.argwhere(np.isfinite(xy[..., 0]))[:, ::-1]
    near = [int(np.argmin(np.linalg.norm(graph.xy - xy[j, i], axis=1))) for i, j in at]
    return at, ij[near]


@pytest.mark.parametrize(
    ("drop", "cut"),
    [((), ()), (((3, 2), (0, 0)), ()), ((), (((3, 2), (4, 2)), ((0, 1), (1, 1)))), (((5, 3), (6, 3), (6, 4)), ())],
)
def test_labels_are_the_true_ones_up_to_a_half_turn(drop, cut):
    graph, ij = lattice_graph(7, 5, drop, cut)
    at, true = places(graph, ij, (7, 5))
    assert len(at) >= len(ij) - 2  # a vertex without a quadrangle goes
    assert np.array_equal(at, true) or np.array_equal(at, [6, 4] - true)


def test_a_frame_around_the_board_is_left_out():
    graph, ij = lattice_graph(9, 7)
    at, true = places(graph, ij, (7, 5))
    assert len(at) == 35
    assert true.min(axis=0).tolist() == [1, 1]


def test_links_outside_quadrangles_and_other_components_go():
    square = {0: {1, 3}, 1: {0, 2}, 2: {1, 3, 4}, 3: {0, 2}, 4: {2, 5}, 5: {4}}
    assert quadrangles_only(square) == {0: {1, 3}, 1: {0, 2}, 2: {1, 3}, 3: {0, 2}}
    assert set(largest_component({**{k: v - {4} for k, v in square.items() if k < 4}, 8: {9}, 9: {8}})) == {0, 1, 2, 3}


def test_uneven_links():
    xy = np.array([[0, 0], [10, 0], [20, 0], [23, 0], [500, 0]], float)
    assert is_even(xy, {0: {1}, 1: {0, 2}, 2: {1}})
    assert not is_even(xy, {1: {2}, 2: {1, 3}, 3: {2}})
    assert not is_even(xy, {0: {1}, 1: {0, 2}, 2: {1, 4}, 4: {2}})
