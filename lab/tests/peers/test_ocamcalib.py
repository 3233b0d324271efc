"""OCamCalib's corner finder: boards on rendered scenes with exact truth, its quadrangles and their links."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn_lab.peers import PEERS
from rcdn_lab.peers.ocamcalib import links, pattern, quadrangles
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import BASE

FIND = PEERS["ocamcalib"].load()
SIZE = (9, 6)
SCENES = {
    "clean": ({"noise": 0.0, "tilt": 5.0}, 0.05),
    "blur 2": ({"blur": 2.0}, 0.2),
    "blur 3": ({"blur": 3.0}, 0.6),
    "barrel 0.5": ({"barrel": 0.5}, 0.1),
    "barrel 1.5": ({"barrel": 1.5}, 0.1),
    "blurred barrel": ({"barrel": 1.0, "blur": 2.0}, 0.25),
}


def judged(made, size=SIZE):
    return score(FIND(made.image, size), Answers(made.boards, [np.ones(len(b.xy)) for b in made.boards]))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", range(2))
def test_whole_boards_with_right_labels(name, seed):
    change, most = SCENES[name]
    done = judged(picture(replace(BASE, **change), [31, seed], SIZE))
    assert done.success
    assert done.gap.mean() < most


@pytest.mark.parametrize("size", [(7, 7), (6, 9), (4, 3)])
def test_boards_of_other_sizes(size):
    assert judged(picture(replace(BASE, square=28), [32, 0], size), size).success


def test_a_board_that_is_smaller_than_asked_for_or_covered_is_not_found():
    assert FIND(picture(BASE, [33, 0], SIZE).image, (10, 6)) == []
    assert FIND(picture(replace(BASE, cover="quadrant"), [34, 0], SIZE).image, SIZE) == []


@pytest.mark.parametrize("kind", ["plain", "noise", "shapes", "text"])
def test_no_board_in_clutter(kind):
    assert FIND(picture(replace(BASE, boards=0, clutter=kind), [35, 0], SIZE).image, SIZE) == []


def squares(places, side=20, gap=2):
    """Squares of a checkerboard at (column, row), `gap` px apart at their corners."""
    at = np.array(places, float)[:, None] * side + 50
    return at + np.array([[gap, gap], [side - gap, gap], [side - gap, side - gap], [gap, side - gap]]) / 1.0


def test_squares_are_linked_at_their_corners():
    quads = squares([(0, 0), (1, 1), (2, 0), (0, 2), (2, 2)])
    assert len(links(quads)) == 4
    assert all((a == 1) != (b == 1) for a, _, b, _ in links(quads))
    found = np.array(list(pattern(quads).values()))
    assert sorted(map(tuple, found.tolist())) == [(70.0, 70.0), (70.0, 90.0), (90.0, 70.0), (90.0, 90.0)]


def test_squares_of_other_sizes_and_far_ones_are_not_linked():
    one, other = squares([(0, 0)]), squares([(1, 1)])
    assert links(np.concatenate([one, other])) != []
    assert links(np.concatenate([one, other + 25])) == []
    large = other[:, :1] + (other - other[:, :1]) * 3
    assert links(np.concatenate([one, large])) == []


def test_quadrangles_by_hand():
    black = np.zeros((100, 120), np.uint8)
    black[20:40, 30:60] = 255
    cv2.fillPoly(black, [np.array([[80, 60], [110, 75], [75, 90]])], 255)
    black[0:10, 0:10] = 255  # touches the border
    found = quadrangles(black)
    assert found.shape == (1, 4, 2)
    assert sorted(map(tuple, found[0].tolist())) == [(30, 20), (30, 39), (59, 20), (59, 39)]
