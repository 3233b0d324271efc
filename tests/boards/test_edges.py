"""Grey levels, sides of links and crossings, against slow versions in NumPy."""

import cv2
import numpy as np
import pytest

from rcdn.boards import edges
from rcdn.boards.edges import crossings, edge_contrast, edge_sharpness, sample_grey

H, W = 90, 120


def picture(kind, seed=0):
    """Smooth noise over the whole range of grey levels."""
    soft = cv2.GaussianBlur(np.random.default_rng(seed).uniform(0, 1, (H, W)), (0, 0), 2)
    return ((soft - soft.min()) / np.ptp(soft) * 255).astype(kind)


def levels(grey, xy):
    """Bilinear grey levels, the border repeated, in double precision."""
    x, y = np.clip(xy[..., 0], 0, W - 1), np.clip(xy[..., 1], 0, H - 1)
    i, j = np.minimum(x.astype(int), W - 2), np.minimum(y.astype(int), H - 2)
    fx, fy = x - i, y - j
    a, b, c, d = (grey[j + below, i + right].astype(float) for below in (0, 1) for right in (0, 1))
    return (a * (1 - fx) + b * fx) * (1 - fy) + (c * (1 - fx) + d * fx) * fy


def spots(count=200, seed=1):
    """Places in the picture and a little outside, and steps of 4 to 50 px from them."""
    rng = np.random.default_rng(seed)
    angle, length = rng.uniform(0, 2 * np.pi, count), rng.uniform(4, 50, count)
    step = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return rng.uniform(-8, [W + 8, H + 8], (count, 2)), step


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_grey_levels(kind):
    grey, xy = picture(kind), spots()[0].reshape(10, 20, 2)
    np.testing.assert_allclose(sample_grey(grey, xy), levels(grey, xy), atol=1e-4)
    corners = np.array([[0, 0], [W - 1, 0], [0, H - 1], [W - 1, H - 1], [-1e9, 5], [1e9, 5]])
    np.testing.assert_allclose(sample_grey(grey, corners), levels(grey, corners), atol=1e-4)
    assert sample_grey(grey, np.zeros((0, 3, 2))).shape == (0, 3)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_contrast_of_links(kind):
    grey, (start, step) = picture(kind), spots()
    length = np.linalg.norm(step, axis=1)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None]
    middle = start[:, None] + np.linspace(0.15, 0.85, 9)[:, None] * step[:, None]
    reach = np.clip(length[:, None] * [0.08, 0.14, 0.2], 1, 5)
    shift = reach[:, None, :, None] * normal[:, None, None]
    sides = levels(grey, middle[:, :, None] + shift) - levels(grey, middle[:, :, None] - shift)
    expected = sides.mean(axis=2).reshape(-1, 3, 3).mean(axis=2)
    np.testing.assert_allclose(edge_contrast(grey, start, start + step), expected, atol=1e-3)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_sharpness_of_links(kind):
    grey, (start, step) = picture(kind), spots()
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1)
    middle = start[:, None] + np.linspace(0.25, 0.75, 9)[:, None] * step[:, None]
    near, far = (
        (levels(grey, middle + r * normal[:, None]) - levels(grey, middle - r * normal[:, None])).mean(axis=1)
        for r in (0.1, 0.3)
    )
    assert edge_sharpness(grey, start, start + step) == pytest.approx(np.median(near / far), abs=1e-4)
    assert edge_sharpness(grey, start[:0], step[:0]) == 0


def edge_offset(grey, xy, across, along, colour):
    """Offset and strength of the edge along `along`, by a matrix that smooths whole profiles."""
    t = np.linspace(-edges.SPAN, edges.SPAN, edges.STEPS)
    gap = (t[:, None] - t) / edges.WIDTH
    kernel = -gap * np.exp(-0.5 * gap * gap)
    kernel *= 2 / edges.WIDTH / np.abs(kernel).sum(axis=1).max()
    halves = []
    for side in (1, -1):
        where = xy + side * edges.ROWS[:, None, None] * along + t[:, None] * across
        slope = np.log(levels(grey, where) + edges.DARK) @ kernel.T
        halves.append(side * colour * np.median(slope, axis=0))
    both = np.minimum(*halves)
    best = both[1:-1].argmax() + 1
    before, peak, after = both[best - 1 : best + 2]
    bend = before - 2 * peak + after
    shift = np.clip(0.5 * (before - after) / bend, -0.5, 0.5) if bend < 0 else 0
    return t[best] + shift * (t[1] - t[0]), peak


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_crossings(kind):
    grey, (xy, du) = picture(kind), spots(60)
    dv = du[:, ::-1] * [-0.9, 0.8]
    colour = np.where(np.arange(60) % 2, 1.0, -1.0)
    offset, strength = crossings(grey, xy, du, dv, colour)
    for k in range(60):
        for way, steps in enumerate(((du, dv), (dv, du))):
            expected = edge_offset(grey, xy[k], steps[0][k], steps[1][k], colour[k])
            assert (offset[k, way], strength[k, way]) == pytest.approx(expected, abs=1e-4)
    assert [a.shape for a in crossings(grey, xy[:0], du[:0], dv[:0], colour[:0])] == [(0, 2), (0, 2)]


def test_levels_below_nothing_are_nothing():
    """An enlarged picture in floating point undershoots beside edges: there is no logarithm of that."""
    grey = np.full((60, 60), 120, np.float32)
    grey[30:, :30] = grey[:30, 30:] = -40
    spot = np.array([[29.5, 29.5]]), np.array([[16.0, 0]]), np.array([[0, 16.0]]), np.ones(1)
    (offset, strength), (expected, typical) = crossings(grey, *spot), crossings(np.maximum(grey, 0), *spot)
    np.testing.assert_allclose(offset, expected, atol=1e-6)
    np.testing.assert_allclose(
        strength, typical, rtol=0.1
    )  # between pixels, the undershoot takes a little of the bright side


def test_places_far_away_are_as_good_as_near_ones():
    """The same patch of picture in another place: positions don't lose digits."""
    patch, (xy, du) = picture(np.uint8), spots(40, seed=5)
    xy = np.clip(xy, 60, [W - 61, H - 31]) - [0, 15]
    du *= 0.3
    far = np.zeros((H, 20000), np.uint8)
    far[:, -W:] = patch
    move = np.array([20000 - W, 0])
    dv = du[:, ::-1] * [-1, 1]
    for one, other in zip(
        crossings(patch, xy, du, dv, np.ones(40)), crossings(far, xy + move, du, dv, np.ones(40)), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_nothing_is_read_outside_tiny_pictures_or_nowhere(shape):
    grey = np.full(shape, 7, np.uint8)
    xy, du, dv = np.array([[0.0, 0], [np.nan, 3], [1e300, -np.inf]]), np.full((3, 2), 9.0), np.full((3, 2), -9.0)
    assert (edge_contrast(grey, xy[:1], xy[:1] + du[:1]) == 0).all()
    assert (crossings(grey, xy, du, dv, np.ones(3))[1][0] <= 40).all()
    assert edge_contrast(grey, xy, xy + du).shape == (3, 3)
    assert sample_grey(grey, xy)[0] == 7


def test_pictures_of_other_kinds_are_refused():
    start = np.zeros((1, 2))
    for grey in (np.zeros((9, 9)), np.zeros((9, 9), np.uint8)[:, ::2]):
        with pytest.raises(Exception, match="uint8 or float32"):
            edge_contrast(grey, start, start + 3)
