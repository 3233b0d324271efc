"""The pixels that a board's corners are fitted to: which, where they lie on the board, and how many."""

import numpy as np
import pytest
from sharp_scene import example

from rcdn.precision.lattice import lattice
from rcdn.precision.window import HALF, batches, windows


def board(seed=0, **settings):
    grey, found, _ = example(seed, **settings)
    rim = (found.ij == found.ij.min(axis=0)) | (found.ij == found.ij.max(axis=0))
    return grey, found, lattice(found.ij, found.xy), rim


@pytest.mark.parametrize("settings", [{}, {"tilt": 60}, {"pitch": 9}, {"pitch": 35, "tilt": 30}])
def test_every_pixel_is_where_the_map_says(settings):
    """Single precision from the corner's own frame against the map itself."""
    grey, found, maps, rim = board(**settings)
    seen = 0
    for batch in batches(grey, maps, found.xy, rim, 0.8):
        w, there = windows(maps, batch), batch.weight > 0
        xy = batch.spot.transpose(1, 2, 0) + batch.centre[:, None]
        uv, slopes = maps.with_slopes(batch.which, xy.astype(float))
        np.testing.assert_allclose(w.u[there], uv[..., 0][there], atol=1e-5)
        np.testing.assert_allclose(w.v[there], uv[..., 1][there], atol=1e-5)
        length = np.linalg.norm(slopes, axis=-1)
        np.testing.assert_allclose(w.gu[there], length[..., 0][there], rtol=1e-4)
        np.testing.assert_allclose(w.gv[there], length[..., 1][there], rtol=1e-4)
        x, y = xy[there].astype(int).T
        np.testing.assert_array_equal(w.value[there], grey[y, x])
        seen += len(batch.which)
    assert seen == len(found)


def test_windows_of_neighbours_share_hardly_a_pixel():
    grey, found, maps, rim = board(tilt=40)
    inner = ~rim.any(axis=1)
    taken = np.zeros(grey.shape, int)
    for batch in batches(grey, maps, found.xy, rim, 0.8):
        for k in np.flatnonzero(inner[batch.which]):
            x, y = (batch.spot[:, k, batch.weight[k] > 0] + batch.centre[k][:, None]).astype(int)
            taken[y, x] += 1
    assert (taken > 1).sum() < 0.02 * (taken > 0).sum()
    assert taken.max() < 3


def test_windows_end_half_way_to_the_next_corner():
    grey, found, maps, rim = board()
    for batch in batches(grey, maps, found.xy, rim, 0.8):
        w, mine = windows(maps, batch), ~rim[batch.which].any(axis=1)
        there = batch.weight[mine] > 0
        assert np.abs(w.u[mine][there]).max() < HALF + 0.05
        assert np.abs(w.v[mine][there]).max() < HALF + 0.05
        assert np.abs(w.u[mine][there]).max() > HALF - 0.1


def test_fewer_pixels_where_fewer_are_enough():
    grey, found, maps, rim = board(pitch=35)
    count = lambda most: sum(b.weight.sum() for b in batches(grey, maps, found.xy, rim, 0.8, most)) / len(found)  # noqa: E731
    every = count(np.inf)
    assert every > 500
    assert 0.6 * 300 < count(300) < 1.5 * 300
    assert 0.5 * 60 < count(60) < 1.6 * 60


def test_no_pixel_comes_from_outside_the_picture():
    grey, found, _, rim = board()
    low = np.floor(found.xy.min(axis=0)).astype(int)
    part = np.ascontiguousarray(grey[low[1] :, low[0] :])
    xy = found.xy - low
    for batch in batches(part, lattice(found.ij, xy), xy, rim, 0.8):
        at = (batch.spot + batch.centre.T[..., None])[:, batch.weight > 0]
        assert at.min() >= 0
        assert (at.max(axis=1) < part.shape[::-1]).all()


def test_corners_off_the_picture_have_no_pixels():
    grey, found, _, rim = board()
    away = lattice(found.ij, found.xy + 2000)
    for batch in batches(grey, away, found.xy + 2000, rim, 0.8):
        assert batch.weight.sum() == 0
        assert windows(away, batch).u.shape == batch.weight.shape
