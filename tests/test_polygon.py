"""How deep points lie in polygons, against OpenCV and squares of known depth."""

import cv2
import numpy as np
import pytest

from rcdn.geometry.polygon import depth

SQUARE = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
ARROW = np.array([[0.0, 0], [20, 5], [0, 10], [6, 5]])  # with a notch


def polygons():
    rng = np.random.default_rng(1)
    yield SQUARE
    yield SQUARE[::-1]
    yield ARROW
    for n in (3, 5, 12, 60):
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        yield (rng.uniform(5, 40, n) * [np.cos(angle), np.sin(angle)]).T  # any simple shape
        yield cv2.convexHull(rng.normal(0, 20, (n, 2)).astype(np.float32)).reshape(-1, 2)


@pytest.mark.parametrize("polygon", list(polygons()), ids=lambda p: str(len(p)))
def test_as_opencv_measures_it(polygon):
    polygon = polygon.astype(np.float32)
    xy = np.random.default_rng(2).uniform(-50, 50, (400, 2)).astype(np.float32)
    known = [cv2.pointPolygonTest(polygon, (float(x), float(y)), True) for x, y in xy]
    found = depth(polygon, xy)
    np.testing.assert_allclose(found, known, atol=1e-4)
    assert (found > 0).any()
    assert (found < 0).any()


def test_known_depths():
    xy = [[5, 5], [1, 5], [9.5, 3], [-2, 5], [5, 13], [-3, -4], [13, 14], [0, 5], [10, 10], [5, 0]]
    np.testing.assert_allclose(depth(SQUARE, xy), [5, 1, 0.5, -2, -3, -5, -5, 0, 0, 0], atol=1e-12)


def test_a_notch_is_outside():
    assert depth(ARROW, [[3, 5]])[0] < 0 < depth(ARROW, [[9, 5]])[0]


def test_turned_and_moved_alike():
    rng = np.random.default_rng(3)
    xy, turn = rng.uniform(-5, 15, (100, 2)), 0.7
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = depth(3 * ARROW @ R.T + [100, -40], 3 * xy @ R.T + [100, -40])
    np.testing.assert_allclose(moved, 3 * depth(ARROW, xy), atol=1e-9)


def test_where_the_outline_begins_does_not_matter():
    xy = np.random.default_rng(4).uniform(-5, 25, (200, 2))
    for k in range(4):
        np.testing.assert_allclose(depth(np.roll(ARROW, k, axis=0), xy), depth(ARROW, xy), atol=1e-12)
        np.testing.assert_allclose(depth(np.roll(ARROW[::-1], k, axis=0), xy), depth(ARROW, xy), atol=1e-12)


def test_corners_that_come_twice_change_nothing():
    xy = np.random.default_rng(5).uniform(-5, 15, (100, 2))
    twice = np.repeat(SQUARE, [1, 3, 1, 2], axis=0)
    np.testing.assert_allclose(depth(twice, xy), depth(SQUARE, xy), atol=1e-12)


def test_little_polygons():
    """A point and a line have an outline, and nothing inside; without corners everything is infinitely far."""
    xy = np.array([[3.0, 4], [0, 0]])
    np.testing.assert_allclose(depth([[0.0, 0]], xy), [-5, 0], atol=1e-12)
    np.testing.assert_allclose(depth([[0.0, 0], [6, 0]], xy), [-4, 0], atol=1e-12)
    assert (depth(np.zeros((0, 2)), xy) == -np.inf).all()
    assert depth(SQUARE, np.zeros((0, 2))).shape == (0,)


def test_shapes_of_opencv_are_taken():
    hull = cv2.convexHull(SQUARE.astype(np.float32))
    assert hull.shape == (4, 1, 2)
    np.testing.assert_allclose(depth(hull, [[4.0, 5]]), 4)
    np.testing.assert_allclose(depth(hull, np.array([4, 5])), 4)
