"""The rendered pair is what it says: whole boards in both cameras, exact truth, one mount,
the same pictures each time."""

import functools

import numpy as np
import pytest

from rcdn.geometry import project
from rcdn.synthetic import render, truth
from rcdn_lab.paper import stereo_pair

pytestmark = pytest.mark.xdist_group("stereo pair")  # the same views
IJ = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2)
POINTS = np.column_stack([IJ, np.zeros(len(IJ)), np.ones(len(IJ))])


@functools.cache
def views():
    return stereo_pair.views(8)


def test_true_corners_are_the_boards_under_the_true_cameras_and_poses():
    for view in views():
        for c, side in enumerate(stereo_pair.SIDES):
            xy = project(stereo_pair.camera_of(side), (POINTS @ view.T[c].T)[:, :3])
            np.testing.assert_allclose(xy, view.xy[c], atol=1e-9)


def test_one_place_of_the_cameras_explains_all_views():
    T = stereo_pair.right_from_left(stereo_pair.SPACING)
    for view in views():
        np.testing.assert_allclose(T @ view.T[0], view.T[1], atol=1e-9)
    metres = stereo_pair.right_from_left()
    np.testing.assert_allclose(metres[:3, 3], T[:3, 3] * stereo_pair.SPACING)
    np.testing.assert_allclose(-metres[:3, :3].T @ metres[:3, 3], stereo_pair.CENTRE)


def test_all_corners_are_plainly_visible_to_both():
    for view in views():
        for scene in view.scenes:
            assert truth(scene)[0].visible.all()


def test_views_differ_in_distance_tilt_noise_and_blur():
    many = stereo_pair.views(40)
    depth = np.array([v.T[0, 2, 3] for v in many]) * stereo_pair.SPACING
    tilt = np.degrees(np.arccos([v.T[0, 2, 2] for v in many]))
    sensors = [v.scenes[0].sensor for v in many]
    assert depth.max() > 2 * depth.min()
    assert tilt.min() < 15
    assert tilt.max() > 45
    for values in ([s.noise for s in sensors], [s.blur for s in sensors]):
        assert max(values) > 2 * min(values)


def test_the_same_seed_gives_the_same_views_and_more_of_them():
    again, other = stereo_pair.views(3), stereo_pair.views(3, seed=1)
    for a, b, c in zip(views(), again, other, strict=False):
        assert a.scenes == b.scenes
        assert a.scenes != c.scenes


@pytest.mark.parametrize("side", [0, 1])
def test_the_picture_shows_the_corners_where_the_truth_has_them(side):
    """The square inside (0, 0) is dark, the one across the corner too, and its neighbours are bright."""
    view = next(v for v in views() if v.scenes[0].sensor.motion == 0)
    picture, xy = render(view.scenes[side], samples=1).astype(float), view.xy[side].reshape(6, 9, 2)
    middles = np.rint((xy[1:, 1:] + xy[1:, :-1] + xy[:-1, 1:] + xy[:-1, :-1]) / 4).astype(int)
    grey = picture[middles[..., 1], middles[..., 0]]
    dark = np.add.outer(np.arange(5), np.arange(8)) % 2 == 0
    local = (grey[:, :-1] - grey[:, 1:]) * np.where(dark[:, :-1], -1, 1)
    assert (local > 0).all()
