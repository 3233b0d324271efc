"""ROCHADE: thinning, the graph of edges, boards of known size in it, saddles on rendered scenes with exact truth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import label

from rcdn.metrics import match
from rcdn_lab.peers import PEERS
from rcdn_lab.peers.rochade import board_in, rochade_board
from rcdn_lab.peers.rochade_graph import EdgeGraph, edge_graph, thin
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import BASE

FIND = PEERS["rochade"].load()
SIZE = (9, 6)
SCENES = {
    "clean": {"noise": 0.0, "tilt": 5.0},
    "noise 10": {"noise": 10.0},
    "tilt 45": {"tilt": 45.0},
    "barrel": {"barrel": 0.5},
    "small squares": {"square": 10.0},
    "blur": {"blur": 2.0},
}
EIGHT = np.ones((3, 3))


def judged(made, size=SIZE):
    grids = FIND(made.image, size)
    return score(grids, Answers(made.boards, [np.ones(len(b.xy)) for b in made.boards]))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", range(2))
def test_whole_boards_with_right_labels(name, seed):
    done = judged(picture(replace(BASE, **SCENES[name]), [31, seed], SIZE))
    assert done.success
    assert done.gap.mean() < 0.1


@pytest.mark.parametrize("size", [(9, 6), (7, 7), (6, 9), (4, 3)])
def test_boards_of_other_sizes(size):
    assert judged(picture(replace(BASE, square=28), [32, 0], size), size).success


@pytest.mark.parametrize("size", [(10, 6), (9, 7), (12, 9)])
def test_a_board_that_is_smaller_than_asked_for_is_not_found(size):
    assert FIND(picture(BASE, [33, 0], SIZE).image, size) == []


def test_a_covered_board_is_not_found():
    """Whole boards only, like the original."""
    assert FIND(picture(replace(BASE, cover="quadrant"), [34, 0], SIZE).image, SIZE) == []


@pytest.mark.parametrize("kind", ["plain", "noise", "shapes", "text"])
def test_no_board_in_clutter(kind):
    assert FIND(picture(replace(BASE, boards=0, clutter=kind), [35, 0], SIZE).image, SIZE) == []


def test_a_large_picture_is_looked_at_reduced_and_measured_in_full():
    """Three times as large: pixel x is 3 x + 1 then."""
    made = picture(replace(BASE, noise=0.0), [36, 0], SIZE)
    large = cv2.resize(made.image, None, fx=3, fy=3, interpolation=cv2.INTER_LINEAR)
    xy = rochade_board(large, SIZE)
    pairs, gaps = match(xy.reshape(-1, 2), 3 * made.boards[0].xy + 1, 3)
    assert len(pairs) == 54
    assert gaps.mean() < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_thinning_keeps_what_hangs_together_and_nothing_wide(seed):
    """Lines and blobs: as many parts as before, all within the mask, no 2 × 2 px left but where lines meet, and
    thinning again changes nothing."""
    rng = np.random.default_rng(seed)
    mask = np.zeros((120, 140), np.uint8)
    for a, b, c, d in rng.integers(10, 110, (8, 4)).tolist():
        cv2.line(mask, (a, b), (c, d), 1, int(rng.integers(2, 7)))
    thinned = thin(mask)
    assert set(np.unique(thinned)) == {0, 1}
    assert not (thinned & ~mask & 1).any()
    assert label(thinned, EIGHT)[1] == label(mask, EIGHT)[1]
    assert np.array_equal(thin(thinned), thinned)
    assert cv2.erode(thinned, np.ones((3, 3), np.uint8)).sum() == 0
    assert thinned.sum() < 0.5 * mask.sum()


def test_thinning_by_hand():
    """A bar of 9 × 3 px leaves its middle line; a cross keeps four arms that meet."""
    bar = np.zeros((9, 15), np.uint8)
    bar[3:6, 3:12] = 1
    rows, cols = np.nonzero(thin(bar))
    assert set(rows.tolist()) == {4}
    assert len(cols) >= 6
    cross = np.zeros((21, 21), np.uint8)
    cross[9:12, 2:19] = cross[2:19, 9:12] = 1
    thinned = thin(cross)
    assert thinned[10, 4:17].all()
    assert thinned[4:17, 10].all()


def test_the_graph_of_a_board():
    """All inner corners are nodes, joined as they are on the board: 8 · 6 + 9 · 5 links."""
    made = picture(replace(BASE, noise=0.0, square=30, tilt=5.0), [37, 0], SIZE)
    graph = edge_graph(made.image, 3)
    pairs, gaps = match(graph.xy, made.boards[0].xy, 2)
    assert len(pairs) == 54
    assert gaps.mean() < 0.2
    ij = {int(node): made.boards[0].ij[spot] for node, spot in pairs}
    inner = [(a, b) for a, b in graph.links.tolist() if a in ij and b in ij]
    assert len(inner) == 93
    assert all(np.abs(ij[a] - ij[b]).sum() == 1 for a, b in inner)


def lattice_graph(cols, rows, drop=(), cut=()):
    """A graph of a lattice seen from aside, in shuffled order, without the nodes `drop` and the links `cut`;
    and the label of each node."""
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
    flat = u @ [[22.0, 7.0], [-13.0, 16.0]]
    return EdgeGraph(flat / (1 + 0.01 * u[:, :1]) + 300, np.array(links)), np.array(ij)


def is_board(nodes, ij, cols, rows):
    """Do the labels of the nodes (rows, columns) form the whole board, step by step?"""
    spots = ij[nodes]
    steps = [np.unique(np.diff(spots, axis=axis).reshape(-1, 2), axis=0) for axis in (0, 1)]
    return nodes.shape == (rows, cols) and all(len(s) == 1 and np.abs(s).sum() == 1 for s in steps)


@pytest.mark.parametrize("size", [(7, 5), (5, 7)])
def test_a_board_in_a_graph(size):
    graph, ij = lattice_graph(7, 5)
    assert is_board(board_in(graph, size), ij, *size)


def test_a_graph_without_a_corner_has_no_board_and_one_without_a_link_has():
    assert board_in(lattice_graph(7, 5, drop={(3, 2)})[0], (7, 5)) is None
    graph, ij = lattice_graph(7, 5, cut={((3, 2), (4, 2)), ((0, 0), (1, 0))})
    assert is_board(board_in(graph, (7, 5)), ij, 7, 5)


def test_the_frame_around_a_board_is_not_taken_for_corners():
    """Its nodes have three links, or two: the place with most links is inside it."""
    graph, ij = lattice_graph(9, 7)
    nodes = board_in(graph, (7, 5))
    assert is_board(nodes, ij, 7, 5)
    assert ij[nodes].reshape(-1, 2).min(axis=0).tolist() == [1, 1]


def test_pictures_without_edges():
    assert FIND(np.full((100, 120), 128, np.uint8), SIZE) == []
    assert FIND(np.zeros((8, 8), np.uint8), SIZE) == []
