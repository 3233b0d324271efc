"""Rings around corners, written out: what is sampled, and which two sectors explain most."""

import numpy as np
import pytest
from corner_scene import board
from scipy.ndimage import map_coordinates

from rcdn.corners.orientation import HALF_TURN, axes, sample_rings


@pytest.mark.parametrize("kind", [np.uint8, np.float32, np.float64])
def test_rings_are_bilinear_and_repeat_the_border(kind):
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, (40, 50)).astype(kind)
    xy = np.concatenate([rng.uniform(-3, 53, (40, 2)), [[0, 0], [49, 39], [24.5, 20]]])
    radius = rng.uniform(1, 12, (len(xy), 5))
    angle = np.arange(2 * HALF_TURN) * np.pi / HALF_TURN
    x = xy[:, 0, None, None] + radius[..., None] * np.cos(angle)
    y = xy[:, 1, None, None] + radius[..., None] * np.sin(angle)
    expected = map_coordinates(grey.astype(float), [np.clip(y, 0, 39), np.clip(x, 0, 49)], order=1)
    np.testing.assert_allclose(sample_rings(grey, xy, radius), expected, atol=0.01)


def test_sectors_are_the_best_of_all_pairs():
    """Against all pairs of boundaries, on noise and on corners."""
    rng = np.random.default_rng(1)
    grey, truth, _ = board(pitch=20, noise=30)
    xy = np.concatenate([truth, rng.uniform(10, grey.shape[0] - 10, (150, 2))])
    found = axes(grey, xy, 6.0, np.zeros(len(xy), bool))
    rings = sample_rings(grey, xy, np.full((len(xy), 3), 6.0) * [0.8, 1, 1.2]).mean(axis=1).astype(float)
    one, other = rings[:, :HALF_TURN], rings[:, HALF_TURN:]
    folded = (one + other) / 2
    folded -= folded.mean(axis=1, keepdims=True)
    energy = (folded**2).sum(axis=1) + ((one - other) ** 2).sum(axis=1) / 4
    a, b = np.triu_indices(HALF_TURN, k=1)
    bins = np.arange(HALF_TURN)[:, None]
    total = folded @ ((bins >= a) & (bins < b))
    share = total**2 * HALF_TURN / ((b - a) * (HALF_TURN - (b - a))) / energy[:, None]
    best = share.argmax(axis=1)
    np.testing.assert_allclose(found.fit, share.max(axis=1), atol=1e-4)
    ok = found.polarity != 0
    bounds = np.stack([a[best], b[best]], axis=1) - 0.5
    expected = np.sort(bounds % HALF_TURN, axis=1) * np.pi / HALF_TURN
    clear = ok & (np.partition(share, -2, axis=1)[:, -2] < share.max(axis=1) - 1e-4)
    assert clear.sum() > 50
    np.testing.assert_allclose(found.axes[clear], expected[clear], atol=1e-12)
    assert np.isnan(found.axes[~ok]).all()
    sign = np.sign(total[np.arange(len(xy)), best]) * np.where(bounds[:, 0] < 0, -1, 1)
    np.testing.assert_array_equal(found.polarity[clear], sign[clear])


def test_every_corner_by_itself_equals_all_at_once():
    grey, xy, _ = board(pitch=20, noise=10)
    careful, radius = np.arange(len(xy)) % 3 > 0, np.linspace(4, 8, len(xy))
    found = axes(grey, xy, radius, careful)
    for k in range(len(xy)):
        own = axes(grey, xy[k : k + 1], radius[k : k + 1], careful[k : k + 1])
        np.testing.assert_array_equal(own.axes[0], found.axes[k])
        assert (own.contrast[0], own.polarity[0], own.fit[0]) == (found.contrast[k], found.polarity[k], found.fit[k])


def test_places_that_are_none_have_no_axes():
    grey, _, _ = board(pitch=20)
    found = axes(grey, np.array([[np.nan, np.nan], [1e12, -1e12], [-1e300, 3]]), 6.0)
    assert np.isnan(found.axes).all()
    assert found.polarity.tolist() == [0, 0, 0]
