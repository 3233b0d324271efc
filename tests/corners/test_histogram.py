"""Edge directions by the paper's gradient histogram."""

import numpy as np
import pytest
from corner_scene import board, render

from rcdn.corners.histogram import BINS, edge_directions

HALF_BIN = np.pi / BINS / 2


def off(found, truth):
    """Angle between directions, radians."""
    return np.abs((found - truth + np.pi / 2) % np.pi - np.pi / 2)


@pytest.mark.parametrize("turn", np.radians(np.arange(0, 180, 11.0)))
def test_an_ideal_corner_has_its_two_directions(turn):
    """Squares larger than the window, so that only one corner is in it."""
    grey, xy, edges = board(pitch=30, turn=turn, cells=1)
    angles, count = edge_directions(grey, xy)
    assert (count == 2).all()
    assert np.isnan(angles[:, 2:]).all()
    assert ((angles[:, :2] >= 0) & (angles[:, :2] < np.pi)).all()
    truth = np.arctan2(edges[..., 1], edges[..., 0])
    gap = off(angles[:, :2, None], truth[:, None])
    assert gap.min(axis=1).max() < HALF_BIN  # each true direction has its maximum
    assert gap.min(axis=2).max() < HALF_BIN  # and each maximum its true direction


@pytest.mark.parametrize(
    ("settings", "error"),
    [({"pitch": 12}, 3), ({"pitch": 20, "noise": 15}, 5), ({"pitch": 30, "tilt": 1.1, "cells": 2}, 6)],
)
def test_small_noisy_and_tilted_corners_start_boards(settings, error):
    grey, xy, edges = board(**settings)
    angles, count = edge_directions(grey, xy)
    assert np.isin(count, (2, 3, 4)).mean() > 0.9
    truth = np.arctan2(edges[..., 1], edges[..., 0])
    gap = np.nanmin(off(angles[:, :, None], truth[:, None]), axis=1)
    assert np.percentile(np.degrees(gap), 90) < error


def test_three_edges_are_three_maxima_by_falling_weight():
    """A star of three straight edges through one point, of contrasts 5 : 3 : 2."""
    levels = {0.3: 5.0, 1.3: 3.0, 2.4: 2.0}

    def colour(xy):
        x, y = xy[..., 0] - 32, xy[..., 1] - 32
        return sum(w * (y * np.cos(a) > x * np.sin(a)) for a, w in levels.items()) / 10

    angles, count = edge_directions(render(colour, (64, 64)), np.array([[32.0, 32.0]]))
    assert count[0] == 3
    np.testing.assert_allclose(angles[0, :3], list(levels), atol=np.radians(2))


def test_more_than_four_are_counted_and_the_four_strongest_kept():
    def colour(xy):
        x, y = xy[..., 0] - 32, xy[..., 1] - 32
        return sum((y * np.cos(a) > x * np.sin(a)) / 5 for a in np.arange(5) * np.pi / 5 + 0.1)

    angles, count = edge_directions(render(colour, (64, 64)), np.array([[32.0, 32.0]]))
    assert count[0] == 5
    assert np.isfinite(angles).all()


def test_an_edge_has_one_direction_and_a_flat_window_none():
    edge = render(lambda xy: xy[..., 0] * 0.8 + xy[..., 1] * 0.6 > 40, (60, 60))
    angles, count = edge_directions(edge, np.array([[32.0, 24.0]]))
    assert count[0] == 1
    assert off(angles[0, 0], np.arctan2(0.8, -0.6)) < np.radians(1)
    angles, count = edge_directions(np.full((40, 40), 90, np.uint8), np.array([[20.0, 20.0]]))
    assert count[0] == 0
    assert np.isnan(angles).all()


def test_the_window_reaches_from_minus_ten_to_nine():
    """What is brighter two columns beyond it is not seen; one column beyond it, it is, by the gradient inside."""
    for column, seen in ((-12, False), (-11, True), (10, True), (11, False)):
        grey = np.zeros((60, 60), np.float32)
        grey[:, 30 + column] = 100  # the gradients of a bright column are at the two columns beside it
        assert (edge_directions(grey, np.array([[30.2, 29.8]]))[1][0] > 0) == seen, column


@pytest.mark.parametrize("size", [(1, 1), (3, 9), (20, 20)])
def test_tiny_pictures_and_corners_at_the_border(size):
    grey = np.random.default_rng(0).integers(0, 256, size).astype(np.uint8)
    angles, count = edge_directions(grey, np.array([[0.0, 0], [size[1] - 1, size[0] - 1]]))
    assert angles.shape == (2, 4)
    assert (np.isfinite(angles).sum(axis=1) == np.minimum(count, 4)).all()


def test_no_corners_at_all():
    angles, count = edge_directions(np.zeros((5, 5), np.uint8), np.zeros((0, 2)))
    assert angles.shape == (0, 4)
    assert count.shape == (0,)
