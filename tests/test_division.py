"""One coefficient of radial distortion beside a homography: simulated planes under simulated lenses."""

import numpy as np
import pytest

from rcdn.geometry import apply_homography, homography, project, transform
from rcdn.geometry.division import EXACT, Division, _least, _residuals, division_of
from rcdn.types import Camera, Pose

SIZE = (640, 480)
PLANE = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)


def seen(camera, distance=6.0, tilt=0.5):
    R = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [0, 0, distance] - R @ [4, 2.5, 0]
    return project(camera, transform(Pose(T), np.column_stack([PLANE, np.zeros(len(PLANE))])))


def residual(lens, xy):
    """Root mean square distance, px, of `xy` from the plane under the best homography and the lens."""
    gap = xy - lens.distorted(apply_homography(homography(PLANE, lens.undistorted(xy)), PLANE))
    return np.sqrt((gap**2).sum(axis=1).mean())


def test_what_is_undistorted_is_distorted_back():
    lens = Division(-0.6, np.array([310.0, 250.0]), 400.0)
    xy = np.random.default_rng(1).uniform(0, 480, (200, 2))
    assert np.abs(lens.distorted(lens.undistorted(xy)) - xy).max() < 1e-9


@pytest.mark.parametrize("coefficient", [-0.6, 0.0, 0.3])
def test_slopes_are_the_derivatives(coefficient):
    lens = Division(coefficient, np.array([310.0, 250.0]), 400.0)
    xy, step = np.random.default_rng(2).uniform(0, 480, (50, 2)), 1e-3
    numeric = [(lens.undistorted(xy + d) - lens.undistorted(xy - d)) / (2 * step) for d in step * np.eye(2)]
    np.testing.assert_allclose(lens.slopes(xy), np.stack(numeric, axis=-1), atol=1e-7)


def test_nothing_is_seen_beyond_the_edge_of_a_lens():
    lens = Division(-0.25, np.array([310.0, 250.0]), 400.0)
    assert lens.sees(np.array([[310.0, 1049.0], [310.0, 1051.0], [1200.0, 250.0]])).tolist() == [True, False, False]


def test_a_board_under_such_a_lens_shows_its_coefficient():
    pinhole = Camera([[300.0, 0, 319.5], [0, 300, 239.5], [0, 0, 1]], [], SIZE, "pinhole")
    true = Division(-0.7, np.array([319.5, 239.5]), 400.0)
    xy = true.distorted(seen(pinhole)) + np.random.default_rng(2).normal(0, 0.02, (len(PLANE), 2))
    found = division_of(PLANE, xy, SIZE)
    assert found.coefficient == pytest.approx(-0.7, abs=0.005)
    assert residual(found, xy) < 0.04


def test_it_follows_an_equidistant_lens_of_150_degrees():
    """A homography misses by a tenth of a square and more."""
    focal = 640 / np.radians(150)
    camera = Camera([[focal, 0, 319.5], [0, focal, 239.5], [0, 0, 1]], [0.0] * 4, SIZE, "fisheye")
    xy = seen(camera)
    found = division_of(PLANE, xy, SIZE)
    assert residual(found, xy) < 0.3
    assert residual(Division(0.0, found.middle, found.scale), xy) > 3


def test_no_lens_is_seen_where_none_is():
    pinhole = Camera([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], [], SIZE, "pinhole")
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 0.1, (len(PLANE), 2))
        assert division_of(PLANE, seen(pinhole) + noise, SIZE) is None


def test_too_few_points_show_no_lens():
    assert division_of(PLANE[:11], PLANE[:11], SIZE) is None


def test_residuals_are_those_of_the_best_homography_under_each_coefficient():
    pinhole = Camera([[300.0, 0, 319.5], [0, 300, 239.5], [0, 0, 1]], [], SIZE, "pinhole")
    middle = np.array([319.5, 239.5])
    xy = Division(-0.7, middle, 400.0).distorted(seen(pinhole)) + np.random.default_rng(4).normal(0, 2, PLANE.shape)
    tried = np.array([-0.9, -0.3, 0.0, 0.2])
    expected = [residual(Division(c, middle, 400.0), xy) / 400 for c in tried]
    np.testing.assert_allclose(_residuals(tried, PLANE, (xy - middle) / 400), expected, rtol=1e-9)


def test_where_the_lens_shows_nothing_there_is_no_residual():
    inward = np.array([[0.0, 0.0], [1, 0], [0, 1], [1, 1]])
    assert _residuals(np.array([-2.0]), inward, np.ones((4, 2)) * np.nan) == [np.inf]
    wide = _residuals(np.array([0.0, 5.0]), PLANE, PLANE / 8)  # 1 − 4 c r² is negative at the rim
    assert wide[0] < 1e-12
    assert wide[1] == np.inf


@pytest.mark.parametrize("least", [0.0, 0.1, 0.731, 1.0])
def test_golden_sections_find_the_least_value_of_an_interval(least):
    at, value = _least(lambda tried: np.abs(tried - least), 0.0, 1.0)
    assert abs(at - least) <= EXACT
    assert value == abs(at - least)
