"""Parts of one board that nothing joins come out as one board; parts of two don't."""

import numpy as np
import pytest

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.metrics import match
from rcdn.synthetic import BoardSpec, Cover, Scene, Sensor, render, truth


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig.auto(threads=1))


def scene(*covers, boards=None):
    board = BoardSpec(12, 7, (0.25, -0.3, 0.1), (-5.2, -3, 21))
    return Scene(640, 480, 500, (320, 240), boards=boards or (board,), covers=covers, sensor=Sensor(noise=2.0))


def test_a_ruler_across_a_board_leaves_one_board(detector):
    """The bar hides one column of corners or so: no edge joins the two halves."""
    shown = scene(Cover(318, -20, 322, 500, 14, 0.6))
    known = truth(shown)[0]
    boards = detector.boards(render(shown))
    assert len(boards) == 1
    pairs, gaps = match(boards[0].xy, known.xy, 2)
    assert len(pairs) == len(boards[0])
    assert len(boards[0]) >= 0.9 * known.visible.sum()
    shift = known.ij[pairs[:, 1]] - boards[0].ij[pairs[:, 0]]
    turned = known.ij[pairs[:, 1]] + boards[0].ij[pairs[:, 0]]
    assert len(np.unique(shift, axis=0)) == 1 or len(np.unique(turned, axis=0)) == 1
    assert gaps.mean() < 0.1


def test_two_boards_a_square_apart_stay_two(detector):
    """Side by side on one plane, but half a square out of step."""
    left = BoardSpec(5, 6, (0.1, 0.1, 0), (-6.5, -3, 20), margin=0.2)
    right = BoardSpec(5, 6, (0.1, 0.1, 0), (0.5, -2.5, 20.3), margin=0.2)
    boards = detector.boards(render(scene(boards=(left, right))))
    assert sorted(b.size for b in boards) == [(5, 6), (5, 6)] or sorted(b.size for b in boards) == [(6, 5), (6, 5)]
