"""ChESS: its formula by hand, what answers and what doesn't, symmetries, corners of a rendered board."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn.metrics import match
from rcdn_lab.peers import chess
from rcdn_lab.peers.chess import RING, chess_corners, chess_orientation, chess_response
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.settings import BASE

SIDE = 41
MIDDLE = SIDE // 2
BOUND = 2040
"""of R for 8 bits: 4 · 2 · 255"""


def shape(inside, blur=0.7, low=0, high=255):
    """Grey uint8 (SIDE, SIDE) of a function of x, y (px from the middle),
    averaged over 8 × 8 samples a pixel, then blurred."""
    fine = (np.arange(SIDE * 8) + 0.5) / 8 - 0.5 - MIDDLE
    x, y = np.meshgrid(fine, fine)
    grey = low + (high - low) * inside(x, y).reshape(SIDE, 8, SIDE, 8).mean(axis=(1, 3))
    return np.rint(cv2.GaussianBlur(grey, (0, 0), blur)).astype(np.uint8)


def corner(degrees, **settings):
    """An X-corner in the middle whose bright squares lie along the direction `degrees` clockwise from the
    upward one, and opposite."""
    a = np.radians(degrees - 45)
    return shape(lambda x, y: (x * np.cos(a) + y * np.sin(a)) * (y * np.cos(a) - x * np.sin(a)) < 0, **settings)


def random_picture(seed=0, size=(60, 70)):
    return np.random.default_rng(seed).integers(0, 256, size).astype(np.uint8)


def by_the_letter(grey, x, y):
    """The formula at one pixel, sample by sample."""
    ring = [
        (0, -5), (2, -5), (3, -3), (5, -2), (5, 0), (5, 2), (3, 3), (2, 5),
        (0, 5), (-2, 5), (-3, 3), (-5, 2), (-5, 0), (-5, -2), (-3, -3), (-2, -5),
    ]  # fmt: skip
    sample = [float(grey[y + dy, x + dx]) for dx, dy in ring]
    total = sum(abs(sample[n] + sample[n + 8] - sample[n + 4] - sample[(n + 12) % 16]) for n in range(4))
    difference = sum(abs(sample[n] - sample[n + 8]) for n in range(8))
    cross = [float(grey[y + dy, x + dx]) for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
    return total - difference - 16 * abs(np.mean(sample) - np.mean(cross))


def test_the_formula_at_every_pixel():
    grey = cv2.GaussianBlur(random_picture(), (0, 0), 1.5)
    grey = cv2.normalize(grey, None, 0, 255, cv2.NORM_MINMAX)
    response = chess_response(grey)
    expected = np.zeros(grey.shape)
    for y in range(5, 55):
        for x in range(5, 65):
            expected[y, x] = max(by_the_letter(grey, x, y), 0)
    assert (expected > 0).sum() > 30
    assert np.allclose(response, expected, atol=0.01)


def test_the_largest_response_of_eight_bits():
    """It takes a ring of two black and two white quarters around a mean grey centre; a picture can't exceed it."""
    grey = np.full((11, 11), 127.5, np.float32)
    for n, (x, y) in enumerate(RING):
        grey[5 + y, 5 + x] = 255 if n % 8 < 4 else 0
    assert chess_response(grey)[5, 5] == BOUND
    for seed in range(5):
        assert chess_response(np.where(random_picture(seed) > 127, 255, 0).astype(np.uint8)).max() <= BOUND


@pytest.mark.parametrize("step", range(8))
@pytest.mark.parametrize("contrast", [(0, 255), (100, 140)])
def test_a_corner_answers_at_its_middle_in_every_direction(step, contrast):
    low, high = contrast
    grey = corner(22.5 * step, low=low, high=high)
    response = chess_response(grey)
    y, x = np.unravel_index(response.argmax(), response.shape)
    assert max(abs(x - MIDDLE), abs(y - MIDDLE)) <= 1
    assert response[MIDDLE, MIDDLE] > 0.6 * BOUND * (high - low) / 255
    xy, _ = chess_corners(grey, 0.3)
    assert len(xy) == 1
    assert np.abs(xy - MIDDLE).max() < 0.1


@pytest.mark.parametrize("step", range(8))
def test_the_direction_of_the_bright_squares(step):
    grey = corner(22.5 * step)
    assert chess_orientation(grey, np.array([[MIDDLE, MIDDLE]])).tolist() == [step]
    assert chess_orientation(255 - grey, np.array([[MIDDLE, MIDDLE]])).tolist() == [(step + 4) % 8]


@pytest.mark.parametrize("degrees", [0, 10, 22.5, 45, 70])
@pytest.mark.parametrize("kind", ["edge", "stripe 4", "stripe 6", "stripes 8"])
def test_edges_and_stripes_do_not_answer(degrees, kind):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    name, _, width = kind.partition(" ")
    across = {
        "edge": lambda d: d > 0,
        "stripe": lambda d: np.abs(d) < float(width) / 2,
        "stripes": lambda d: np.floor(d / float(width)) % 2 == 0,
    }[name]
    grey = shape(lambda x, y: across(x * c + y * s))
    assert chess_response(grey).max() < 0.12 * BOUND
    assert chess_response(grey)[MIDDLE, MIDDLE] < 0.01 * BOUND


def test_flat_pictures_and_dots_do_not_answer():
    grey = np.full((SIDE, SIDE), 90, np.uint8)
    assert not chess_response(grey).any()
    grey[MIDDLE, MIDDLE] = 255
    assert not chess_response(grey).any()


@pytest.mark.parametrize("radius", [5, 10])
@pytest.mark.parametrize("blur", [False, True])
def test_symmetries(radius, blur):
    grey = cv2.GaussianBlur(random_picture(), (0, 0), 2)
    response = chess_response(grey, radius, blur)
    assert response.any()
    for change in (np.rot90, np.fliplr, np.flipud, np.transpose):
        assert np.allclose(chess_response(change(grey), radius, blur), change(response), atol=0.01)
    assert np.allclose(chess_response(255 - grey, radius, blur), response, atol=0.01)


@pytest.mark.parametrize("radius", [5, 10])
def test_only_whole_rings_answer(radius):
    response = chess_response(random_picture(size=(70, 150)), radius)
    assert response.dtype == np.float32
    inner = response[radius:-radius, radius:-radius]
    assert inner.any()
    assert np.count_nonzero(inner) == np.count_nonzero(response)
    assert chess_response(random_picture(size=(2 * radius, 90)), radius).tolist() == np.zeros((2 * radius, 90)).tolist()


def test_the_large_ring_sees_through_blur():
    """Blur of 5 px leaves little on a ring of 5 px."""
    grey = corner(20, blur=5)
    small, large = chess_response(grey, 5), chess_response(grey, 10)
    assert large[MIDDLE, MIDDLE] > 1.5 * small[MIDDLE, MIDDLE]


@pytest.mark.parametrize(("name", "call"), [
    ("radius", lambda g: chess_response(g, 7)),
    ("threshold", lambda g: chess_corners(g, 1.0)),
    ("threshold", lambda g: chess_corners(g, -0.1)),
])  # fmt: skip
def test_bad_settings_are_refused(name, call):
    with pytest.raises(ConfigError, match=name):
        call(random_picture())


def test_suppression_isolated_responses_and_the_centre_of_mass(monkeypatch):
    """Of a map: an isolated positive goes; of two maxima 2 px apart the weaker goes;
    equal neighbours are one corner between them."""
    made = np.zeros((40, 40), np.float32)
    made[5, 5] = 900
    made[10, 10:13] = 100, 60, 90
    made[20, 20:22] = 50
    made[30, 30:32] = 20, 10
    monkeypatch.setattr(chess, "chess_response", lambda *_: made)
    xy, score = chess_corners(made)
    assert score.tolist() == [100, 50, 20]
    assert np.allclose(xy, [[10 + (60 + 2 * 90) / 250, 10], [20.5, 20], [30 + 1 / 3, 30]])
    assert chess_corners(made, 40 / 900)[1].tolist() == [100, 50]


@pytest.mark.parametrize("settings", [{}, {"noise": 10.0}, {"tilt": 45.0}, {"barrel": 0.5}], ids=str)
def test_the_corners_of_a_board(settings):
    made = picture(replace(BASE, square=30, **settings), [11, 0])
    truth = made.boards[0].xy
    xy, _ = chess_corners(made.image, chess.THRESHOLD)
    pairs, gaps = match(xy, truth, 2)
    assert len(pairs) == len(truth)
    assert gaps.mean() < 0.25
    assert len(xy) <= len(truth) + 4
