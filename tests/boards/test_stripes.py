"""Stripes are no board: hazard marking, corrugated sheets, hatching. Their jagged, noisy edges answer like corners."""

import cv2
import numpy as np
import pytest

from rcdn import Detector, DetectorConfig

DETECTOR = Detector(DetectorConfig(threads=1))


def stripes(period, angle, tilt, wavy, seed):
    """A picture (360, 480) of stripes `period` px wide together, in perspective; `wavy`: a sine, as on a corrugated
    sheet."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[-180:180:0.25, -240:240:0.25]
    depth = 1 + tilt * x / 480
    phase = 2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / depth / period
    share = 0.5 + 0.5 * np.sin(phase) if wavy else (np.sin(phase) > 0).astype(float)
    grey = cv2.resize(40 + 150 * share, (480, 360), interpolation=cv2.INTER_AREA)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.7)
    return np.clip(grey + rng.normal(0, 4, grey.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("period", "wavy"), [(9, False), (14, False), (9, True), (14, True), (22, True)])
def test_stripes_are_no_board(period, wavy):
    """In each of these settings their lattice passed as a board in one picture, at least, of the three."""
    for seed, angle, tilt in ((1, 17, 0.3), (2, 31, 0.6), (3, 52, 0.0)):
        assert DETECTOR.detect(stripes(period, np.deg2rad(angle), tilt, wavy, seed)).boards == [], angle


@pytest.mark.parametrize("side", [10, 24])
@pytest.mark.parametrize("angle", [45, 30, 0])
def test_a_board_stays_whole_while_it_moves_by_half_a_diagonal(side, angle):
    """Motion along one diagonal draws a board out to stripes: every second corner becomes dark, the others bright."""
    board = np.add.outer(np.arange(7), np.arange(10)) % 2 * 190.0 + 40
    board = cv2.copyMakeBorder(np.kron(board, np.ones((side, side))), *[side] * 4, cv2.BORDER_CONSTANT, value=230)
    way = np.deg2rad(angle)
    size, moved = board.shape[::-1], np.zeros(board.shape)
    for t in np.linspace(-0.35 * side, 0.35 * side, 41):
        shift = np.array([[1, 0, t * np.cos(way)], [0, 1, t * np.sin(way)]])
        moved += cv2.warpAffine(board, shift, size, borderMode=cv2.BORDER_REPLICATE) / 41
    assert [len(board) for board in DETECTOR.detect(moved.astype(np.uint8)).boards] == [54]


@pytest.mark.parametrize(("side", "light"), [(12, 0.2), (24, 0.1), (36, 0.1), (36, 0.2)])
def test_the_edge_of_a_shadow_along_a_diagonal_takes_no_small_board(side, light):
    """It crosses a third of the sides of a board of 3 × 3 corners, and makes all of these darker at the same end."""
    board = np.add.outer(np.arange(4), np.arange(4)) % 2 * 190.0 + 40
    board = cv2.copyMakeBorder(np.kron(board, np.ones((side, side))), *[side] * 4, cv2.BORDER_CONSTANT, value=230)
    y, x = np.mgrid[: len(board), : len(board)]
    shaded = np.where(x - y > -1.5 * side, light, 1.0) * board
    found = DETECTOR.detect(cv2.GaussianBlur(shaded, (0, 0), 0.7).astype(np.uint8))
    assert [len(board) for board in found.boards] == [9]
