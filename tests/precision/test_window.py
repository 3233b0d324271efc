"""The pixels that a board's corners are fitted to: which, where they lie on the board, and how many."""

import numpy as np
import pytest
from sharp_scene import example
from window_pixels import windows

from rcdn.precision.lattice import lattice
from rcdn.precision.window import frames

HALF = 0.5


def board(seed=0, **settings):
    grey, found, _ = example(seed, **settings)
    rim = (found.ij == found.ij.min(axis=0)) | (found.ij == found.ij.max(axis=0))
    return grey, found, lattice(found.ij, found.xy), rim


def seen(grey, found, maps, rim, blur=0.8, most=np.inf):
    return windows(grey, maps, frames(maps, found.xy, rim, blur, most))


@pytest.mark.parametrize("settings", [{}, {"tilt": 60}, {"pitch": 9}, {"pitch": 35, "tilt": 30}])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_every_pixel_is_where_the_map_says(settings, kind):
    """Single precision from the corner's own frame against the map itself."""
    grey, found, maps, rim = board(**settings)
    w = seen(grey.astype(kind), found, maps, rim)
    xy = w.spot.transpose(1, 2, 0) + w.centre[:, None]
    uv, slopes = maps.with_jacobian(np.arange(len(found)), xy.astype(float))
    np.testing.assert_allclose(w.u[w.mask], uv[..., 0][w.mask], atol=1e-5)
    np.testing.assert_allclose(w.v[w.mask], uv[..., 1][w.mask], atol=1e-5)
    length = np.linalg.norm(slopes, axis=-1)
    np.testing.assert_allclose(w.gu[w.mask], length[..., 0][w.mask], rtol=1e-4)
    np.testing.assert_allclose(w.gv[w.mask], length[..., 1][w.mask], rtol=1e-4)
    x, y = xy[w.mask].astype(int).T
    np.testing.assert_array_equal(w.value[w.mask], grey[y, x])
    assert w.mask.any(axis=1).all()


@pytest.mark.parametrize("settings", [{}, {"tilt": 60}, {"pitch": 9}, {"pitch": 60, "tilt": 30}])
@pytest.mark.parametrize("most", [np.inf, 200])
def test_windows_are_crosses_of_two_bands(settings, most):
    """Pixel by pixel, from what a frame says."""
    grey, found, maps, rim = board(**settings)
    frame = frames(maps, found.xy, rim, 0.8, most)
    w = windows(grey, maps, frame)
    y, x = np.mgrid[-70:71, -70:71]
    for k, f in enumerate(frame):
        u, v = np.abs(np.tensordot(f[:4].reshape(2, 2), [x, y], 1))
        inside = (u <= f[4]) & (v <= f[5]) & ((u <= f[6]) | (v <= f[7])) & ((x + (f[12] + 1) // 2 * y) % f[12] == 0)
        at = np.stack([x + f[8], y + f[9]], axis=-1)
        inside &= (at >= 0).all(axis=-1) & (at < grey.shape[::-1]).all(axis=-1)
        assert set(zip(*w.spot[:, k, w.mask[k]].astype(int), strict=True)) == set(
            zip(x[inside], y[inside], strict=True)
        )
        assert w.mask[k].sum() == inside.sum()


def test_windows_of_neighbours_share_hardly_a_pixel():
    grey, found, maps, rim = board(tilt=40)
    inner = ~rim.any(axis=1)
    taken = np.zeros(grey.shape, int)
    w = seen(grey, found, maps, rim)
    for k in np.flatnonzero(inner):
        x, y = (w.spot[:, k, w.mask[k]] + w.centre[k][:, None]).astype(int)
        taken[y, x] += 1
    assert (taken > 1).sum() < 0.02 * (taken > 0).sum()
    assert taken.max() < 3


def test_windows_end_half_way_to_the_next_corner():
    grey, found, maps, rim = board()
    w, mine = seen(grey, found, maps, rim), ~rim.any(axis=1)
    there = w.mask[mine]
    assert np.abs(w.u[mine][there]).max() < HALF + 0.05
    assert np.abs(w.v[mine][there]).max() < HALF + 0.05
    assert np.abs(w.u[mine][there]).max() > HALF - 0.1


def test_fewer_pixels_where_fewer_are_enough():
    grey, found, maps, rim = board(pitch=35)
    count = lambda most: seen(grey, found, maps, rim, most=most).mask.sum() / len(found)  # noqa: E731
    every = count(np.inf)
    assert every > 500
    assert 0.6 * 300 < count(300) < 1.5 * 300
    assert 0.5 * 60 < count(60) < 1.6 * 60


def test_no_pixel_comes_from_outside_the_picture():
    grey, found, _, rim = board()
    low = np.floor(found.xy.min(axis=0)).astype(int)
    part = np.ascontiguousarray(grey[low[1] :, low[0] :])
    xy = found.xy - low
    maps = lattice(found.ij, xy)
    w = windows(part, maps, frames(maps, xy, rim, 0.8))
    at = (w.spot + w.centre.T[..., None])[:, w.mask]
    assert at.min() >= 0
    assert (at.max(axis=1) < part.shape[::-1]).all()


@pytest.mark.parametrize("far", [2000, -2000, 1e12])
def test_corners_off_the_picture_have_no_pixels(far):
    grey, found, maps, rim = board()
    away = lattice(found.ij, found.xy + far) if abs(far) < 1e6 else maps
    w = windows(grey, away, frames(away, found.xy + far, rim, 0.8))
    assert not w.mask.any()


def test_maps_that_fold_are_told():
    _, found, maps, rim = board()
    maps.terms[5] = 0
    with pytest.raises(np.linalg.LinAlgError):
        frames(maps, found.xy, rim, 0.8)
