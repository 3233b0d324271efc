"""Centres of symmetry and antisymmetry: they are where the cost is least, and each disc stands for itself."""

import numpy as np
import pytest
from corner_scene import board, render
from scipy.ndimage import gaussian_filter, map_coordinates

from rcdn.corners.symmetry import symmetry_centre


def cost(grey, centre, half, anti):
    """What half a turn about `centre` changes (or, `anti`, what isn't its negative but for a level),
    over a disc of the smoothed picture."""
    smooth = gaussian_filter(grey.astype(np.float64), 1.0, mode="nearest", truncate=4)
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
    inside = dx**2 + dy**2 <= (half + 0.5) ** 2
    d = np.stack([dy[inside], dx[inside]])
    one, other = (map_coordinates(smooth, centre[::-1, None] + s * d, order=1, mode="nearest") for s in (1, -1))
    rest = one + other if anti else one - other
    return float(((rest - rest.mean()) ** 2).sum()) if anti else float((rest**2).sum())


def star(xy):
    """Six sectors about (30.3, 29.6)."""
    angle = np.arctan2(xy[..., 1] - 29.6, xy[..., 0] - 30.3) + 0.2
    return np.floor(angle / (np.pi / 3)).astype(int) % 2 == 0


@pytest.mark.parametrize("half", [2, 5, 10, 13])
@pytest.mark.parametrize("anti", [False, True])
def test_no_place_around_costs_less(half, anti):
    if anti:
        grey, start = render(star, (60, 60), noise=8), np.array([[30.6, 29.3]])
    else:
        grey, truth, _ = board(pitch=30, noise=8)
        start = truth[20:26] + 0.25
    found = symmetry_centre(grey, start, half, anti=anti)
    assert np.isfinite(found).any()
    for centre in found[np.isfinite(found[:, 0])]:
        own = cost(grey, centre, half, anti)
        around = [
            cost(grey, centre + 0.1 * np.array([np.cos(t), np.sin(t)]), half, anti) for t in np.arange(8) * np.pi / 4
        ]
        assert own < min(around)


def test_antisymmetry_needs_no_known_level():
    grey = render(star, (60, 60)).astype(np.float32)
    start = np.array([[30.8, 29.1]])
    found = symmetry_centre(grey, start, 10, anti=True)
    np.testing.assert_allclose(found, [[30.3, 29.6]], atol=0.03)
    np.testing.assert_allclose(symmetry_centre(0.5 * grey + 100, start, 10, anti=True), found, atol=1e-4)


def test_discs_of_many_sizes_at_once_equal_one_by_one():
    grey, truth, _ = board(pitch=20, noise=5)
    half = np.random.default_rng(0).integers(2, 11, len(truth))
    together = symmetry_centre(grey, truth, half)
    alone = np.concatenate([symmetry_centre(grey, truth[k : k + 1], int(half[k])) for k in range(len(truth))])
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize("anti", [False, True])
def test_what_is_no_place_has_no_centre(anti):
    grey, _, _ = board(pitch=20)
    nowhere = np.array([[np.nan, 5], [5, np.inf], [1e300, 5], [-1e12, -1e12], [1e6, 1e6]])
    assert np.isnan(symmetry_centre(grey, nowhere, 5, anti=anti)).all()
    assert symmetry_centre(grey, np.zeros((0, 2)), 5, anti=anti).shape == (0, 2)


def test_the_kind_of_picture_doesnt_matter():
    """Bytes, reals, and pictures whose pixels don't lie in a row."""
    grey, truth, _ = board(pitch=20, noise=5)
    found = symmetry_centre(grey, truth, 6)
    for other in (
        grey.astype(np.float32),
        grey.astype(np.float64),
        np.asfortranarray(grey),
        np.repeat(grey, 2, 1)[:, ::2],
    ):
        np.testing.assert_array_equal(symmetry_centre(other, truth, 6), found)
