"""Derivatives of projections and rotations against differences, and the rational lens against OpenCV."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.errors import RcdnError
from rcdn.geometry import cross_matrix, project, project_with_jacobian, rotation, unproject
from rcdn.types import Camera

K = np.array([[610.0, 0, 322], [0, 590, 243], [0, 0, 1]])
RATIONAL = [0.4, -0.05, 0.002, -0.003, 0.01, 0.75, 0.05, -0.002]
CAMERAS = [
    Camera(K, [], (640, 480), "pinhole"),
    Camera(K, [-0.3, 0.1, 0.002, -0.001], (640, 480), "brown"),
    Camera(K, [-0.3, 0.1, 0.002, -0.001, 0.02], (640, 480), "brown"),
    Camera(K, RATIONAL, (640, 480), "rational"),
    Camera(K, [0.03, -0.008, 0.002, -0.0005], (640, 480), "fisheye"),
]


def points(seed=0, count=50):
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.5, 3, count)
    return np.stack([rng.uniform(-0.6, 0.6, count) * z, rng.uniform(-0.5, 0.5, count) * z, z], axis=-1)


def differences(function, x, step=1e-6):
    """Central differences (..., len(x)) of `function` at the vector `x`."""
    columns = []
    for k in range(len(x)):
        d = np.zeros(len(x))
        d[k] = step * max(1.0, abs(x[k]))
        columns.append((function(x + d) - function(x - d)) / (2 * d[k]))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: f"{c.model}{len(c.distortion)}")
def test_slopes_are_those_of_differences(camera):
    p = points()
    p[0, :2] = 0.0  # on the axis
    xy, by_point, by_parameter = project_with_jacobian(camera, p)
    assert np.array_equal(xy, project(camera, p))
    for k in range(len(p)):
        assert by_point[k] == pytest.approx(differences(lambda q: project(camera, q), p[k]), abs=2e-5, rel=1e-6)
    moved = differences(lambda a: project(camera.with_parameters(a), p), camera.parameters)
    assert by_parameter == pytest.approx(moved, abs=2e-5, rel=1e-6)


def test_fisheye_slopes_hold_beside_and_behind_the_camera():
    camera = CAMERAS[-1]
    p = np.array([[1.0, 0.2, 0.0], [0.8, -0.6, -0.2], [-1.0, 0.1, -0.5]])
    _, by_point, _ = project_with_jacobian(camera, p)
    for k in range(len(p)):
        assert by_point[k] == pytest.approx(differences(lambda q: project(camera, q), p[k]), abs=2e-5)


def test_rational_is_that_of_opencv_and_goes_there_and_back():
    p = points(3, 300)
    camera = CAMERAS[3]
    reference = cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, np.array(RATIONAL))[0][:, 0]
    xy = project(camera, p)
    assert xy == pytest.approx(reference, abs=1e-9)
    assert unproject(camera, xy) == pytest.approx(p / p[:, 2:], abs=1e-9)


def test_a_pole_of_the_rational_lens_has_no_ray_beyond_it():
    camera = Camera(K, [0, 0, 0, 0, 0, -0.5, 0, 0], (640, 480), "rational")  # r/(1 − r²/2) has its pole at r = √2
    near = np.array([[1.2, 0.0, 1.0]])
    assert unproject(camera, project(camera, near)) == pytest.approx(near, abs=1e-8)
    beyond = np.array([[1.6, 0.0, 1.0]])
    back = unproject(camera, project(camera, beyond))
    assert np.isnan(back).any() or np.abs(back - beyond).max() > 0.1


def test_division_is_refused():
    with pytest.raises(RcdnError, match="division"):
        project_with_jacobian(Camera(K, [-0.1], (640, 480), "division"), points())


def test_rotations_are_those_of_scipy():
    rng = np.random.default_rng(1)
    v = np.concatenate([rng.normal(size=(20, 3)), 1e-6 * rng.normal(size=(3, 3)), np.zeros((1, 3))])
    assert rotation(v) == pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=1e-12)


def test_cross_matrix():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 7, 3))
    assert (cross_matrix(a) @ b[:, :, None])[..., 0] == pytest.approx(np.cross(a, b))
