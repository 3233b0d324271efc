"""Homographies, lenses and poses against OpenCV and against themselves."""

import cv2
import numpy as np
import pytest

from rcdn.errors import RcdnError
from rcdn.geometry import apply_homographies, apply_homography, homography, project, rotation, transform, unproject
from rcdn.geometry.homography import depths, in_front
from rcdn.geometry.jacobians import project_with_jacobian
from rcdn.types import Camera, Pose

K = np.array([[600.0, 0, 320], [0, 580, 240], [0, 0, 1]])
BROWN = np.array([[-0.3, 0.1, 0.002, -0.001, 0], [0.2, -0.05, -0.003, 0.004, 0.02], [-0.05, 0.01, 0, 0, -0.01]])
FISHEYE = np.array([[0.03, -0.008, 0.002, -0.0005], [-0.04, 0.01, -0.003, 0.001], [0, 0, 0, 0]])


def rays(widest, count=400, seed=0):
    """Unit rays up to `widest` radians off the axis, some of them on it."""
    rng = np.random.default_rng(seed)
    theta, phi = widest * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    theta[:5] = 0
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


@pytest.mark.parametrize("distortion", [*BROWN, BROWN[0, :4]])
def test_brown_is_that_of_opencv(distortion):
    points = rays(0.6) * np.random.default_rng(1).uniform(0.5, 9, (400, 1))
    reference = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, distortion)[0][:, 0]
    assert project(Camera(K, distortion, (640, 480)), points) == pytest.approx(reference, abs=1e-9)


@pytest.mark.parametrize("distortion", FISHEYE)
def test_fisheye_is_that_of_opencv(distortion):
    points = rays(1.4) * np.random.default_rng(1).uniform(0.5, 9, (400, 1))
    reference = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, distortion)[0][:, 0]
    assert project(Camera(K, distortion, (640, 480), "fisheye"), points) == pytest.approx(reference, abs=1e-9)


@pytest.mark.parametrize("distortion", FISHEYE)
def test_a_fisheye_sees_nothing_straight_behind_it(distortion):
    camera = Camera(K, distortion, (640, 480), "fisheye")
    points = np.array([[0, 0, -1], [1e-12, 0, -1], [0, 0, -1e-9], [0, 0, 0], [0, 0, 1], [1e-12, 0, 1], [1, 0, -1.0]])
    xy, by_point, _ = project_with_jacobian(camera, points)
    assert np.array_equal(xy, project(camera, points), equal_nan=True)
    assert np.isnan(xy[:4]).all()
    assert xy[4:6] == pytest.approx(np.tile(K[:2, 2], (2, 1)), abs=1e-8)
    assert np.isfinite(by_point[4:]).all()
    assert xy[6, 0] > 640
    assert np.isnan(camera.project(points[:4])).all()


def there_and_back(camera, directions):
    """Largest gap of unproject(project) to directions, which come as `unproject` gives them."""
    return np.abs(unproject(camera, project(camera, directions)) - directions).max()


def test_pinhole_there_and_back():
    skewed = K + np.diag([3.0, 0], 1)
    d = rays(1.2)
    assert there_and_back(Camera(skewed, (), (640, 480), "pinhole"), d / d[:, 2:]) < 1e-12
    on_axis = project(Camera(skewed, (), (640, 480), "pinhole"), np.array([0.0, 0, 3]))
    assert on_axis.tolist() == [320, 240]


@pytest.mark.parametrize("distortion", [*BROWN, [0.6, 0.3, 0, 0, 0.1]], ids=["barrel", "mixed", "weak", "pincushion"])
def test_brown_there_and_back(distortion):
    """To 0.95 of the fold, or 65° where there is none."""
    distortion = np.asarray(distortion, float)
    d = rays(min(1.13, 0.95 * fold(distortion)))
    assert there_and_back(Camera(K, distortion, (640, 480)), d / d[:, 2:]) < 1e-9


def fold(distortion, slope=0.0):
    """The angle at which the radial map of a brown lens first turns back, or grows by less than `slope`, by search."""
    r = np.linspace(0, 3, 30001)
    k1, k2, k3 = distortion[0], distortion[1], distortion[4]
    falls = np.diff(r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)) <= slope * 1e-4
    return np.arctan(r[np.argmax(falls)]) if falls.any() else np.inf


@pytest.mark.parametrize("distortion", FISHEYE)
def test_fisheye_there_and_back(distortion):
    """Behind the camera too, up to the fold."""
    t = np.linspace(0, np.pi, 30001)
    falls = np.diff(t * (1 + sum(k * t ** (2 * n + 2) for n, k in enumerate(distortion)))) <= 0
    last = t[np.argmax(falls)] if falls.any() else 3.1
    assert last > 1.6
    assert there_and_back(Camera(K, distortion, (640, 480), "fisheye"), rays(0.98 * last)) < 1e-9


@pytest.mark.parametrize("k", [-2.5, -0.5, 0.0, 0.3])
def test_division_there_and_back(k):
    """A barrel up to 170° off the axis; a cushion to its fold at |d|² = 1 / k, where |x / z| is 1 / (2 √k)."""
    widest = {-2.5: 2.96, -0.5: 2.96, 0.0: 1.5, 0.3: np.arctan(0.99 / (2 * np.sqrt(0.3)))}[k]
    assert there_and_back(Camera(K, (k,), (640, 480), "division"), rays(widest)) < 1e-9


def test_division_is_its_definition():
    camera = Camera(K, (-0.8,), (640, 480), "division")
    d = np.random.default_rng(2).uniform(-0.6, 0.6, (50, 2))
    n = d / (1 - 0.8 * (d**2).sum(axis=1, keepdims=True))
    seen = project(camera, 7 * np.column_stack([n, np.ones(50)]))
    assert seen == pytest.approx(d @ K[:2, :2].T + K[:2, 2], abs=1e-9)
    assert np.linalg.norm(d, axis=1).max() < np.linalg.norm(n, axis=1).max()  # a barrel pulls towards the middle


def test_division_without_distortion_is_a_pinhole():
    points = rays(1.2) * 3
    pinhole = project(Camera(K, (), (640, 480), "pinhole"), points)
    assert project(Camera(K, (0.0,), (640, 480), "division"), points) == pytest.approx(pinhole, abs=1e-9)


def test_a_cushion_of_the_division_model_folds():
    camera = Camera(K, (0.25,), (640, 480), "division")  # at |d| = 2
    pixels = np.array([[320 + 600 * 1.999, 240], [320 + 600 * 2.001, 240]])
    assert np.isfinite(unproject(camera, pixels)).all(axis=1).tolist() == [True, False]


def test_random_lenses_there_and_back():
    rng = np.random.default_rng(3)
    for _ in range(40):
        k = rng.uniform(-1, 1, 4) * [0.04, 0.01, 0.003, 0.001]
        assert there_and_back(Camera(K, k, (640, 480), "fisheye"), rays(1.5, 50)) < 1e-9
        k = rng.uniform([-0.4, -0.1, -0.005, -0.005, -0.02], [0.3, 0.1, 0.005, 0.005, 0.02])
        d = rays(min(1.2, fold(k, 0.1)), 50)
        assert there_and_back(Camera(K, k, (640, 480)), d / d[:, 2:]) < 1e-9


def test_beyond_the_fold_there_is_no_ray():
    """r (1 − 0.4 r²) turns back at r = 0.9129, where it is 0.6086."""
    camera = Camera(K, (-0.4, 0, 0, 0), (640, 480))
    pixels = np.array([[320 + 600 * 0.6085, 240], [320 + 600 * 0.6087, 240], [320 + 600 * 3.0, 240]])
    assert np.isfinite(unproject(camera, pixels)).tolist() == [[True] * 3, [False, False, True], [False, False, True]]
    turns = Camera(K, (-0.1, 0, 0, 0), (640, 480), "fisheye")  # θ (1 − 0.1 θ²) at √(10/3), where it is 1.2172
    pixels = np.array([[320 + 600 * 1.2171, 240], [320 + 600 * 1.2173, 240]])
    assert np.isfinite(unproject(turns, pixels)).all(axis=1).tolist() == [True, False]


def test_a_lens_that_rises_again_gives_the_ray_before_its_fold():
    camera = Camera(K, (0.01607, -0.00784, -0.002708, 0.00031214), (640, 480), "fisheye")
    d = rays(2.0)
    assert there_and_back(camera, d) < 1e-9
    t = np.linspace(0, 2.5, 2501)
    peak = project(camera, np.stack([np.sin(t), 0 * t, np.cos(t)], axis=-1))[:, 0].max() - 320
    pixels = np.array([[320 + peak * 0.999, 240], [320 + peak * 1.05, 240]])
    assert np.isfinite(unproject(camera, pixels)).all(axis=1).tolist() == [True, False]


def test_behind_the_camera():
    points = np.array([[0.1, 0.1, -1], [0.1, 0.1, 0.0], [0.1, 0.1, 1]])
    for model, k in (("pinhole", ()), ("brown", BROWN[0]), ("division", (0.1,)), ("division", (0,))):
        assert np.isfinite(project(Camera(K, k, (640, 480), model), points)).all(axis=1).tolist() == [
            False,
            False,
            True,
        ]
    assert np.isfinite(project(Camera(K, FISHEYE[2], (640, 480), "fisheye"), points)).all()
    assert np.isfinite(project(Camera(K, (-0.1,), (640, 480), "division"), points)).all()


def test_shapes_are_kept():
    for camera in (
        Camera(K, BROWN[0], (640, 480)),
        Camera(K, FISHEYE[0], (640, 480), "fisheye"),
        Camera(K, (-0.4,), (640, 480), "division"),
    ):
        pixels = np.full((2, 3, 2), 300.0)
        assert unproject(camera, pixels).shape == (2, 3, 3)
        assert unproject(camera, pixels[0, 0]) == pytest.approx(unproject(camera, pixels)[0, 0], abs=1e-15)
        assert project(camera, unproject(camera, pixels)) == pytest.approx(pixels, abs=1e-9)
        assert np.isnan(unproject(camera, np.array([np.nan, 1.0]))).any()


H = np.array([[1.2, 0.1, 30], [-0.2, 0.9, -4], [1e-3, -5e-4, 1]])


@pytest.mark.parametrize("count", [4, 5, 60])
def test_homography_is_exact(count):
    src = np.random.default_rng(count).uniform(0, 400, (count, 2))
    found = homography(src, apply_homography(H, src))
    assert found / found[2, 2] == pytest.approx(H, abs=1e-9)


def test_many_homographies_map_as_each_does():
    rng = np.random.default_rng(4)
    H, points = np.eye(3) + rng.normal(0, 1e-3, (5, 3, 3)), rng.uniform(0, 100, (7, 2))
    np.testing.assert_allclose(apply_homographies(H, points), [apply_homography(h, points) for h in H], rtol=1e-12)
    assert apply_homographies(H[:0], points).shape == (0, 7, 2)


def test_homography_against_opencv_under_noise():
    rng = np.random.default_rng(5)
    src = rng.uniform(0, 400, (200, 2))
    dst = apply_homography(H, src) + rng.normal(0, 0.1, (200, 2))
    ours, theirs = apply_homography(homography(src, dst), src), apply_homography(cv2.findHomography(src, dst)[0], src)
    assert np.abs(ours - theirs).max() < 0.02
    assert np.abs(ours - apply_homography(H, src)).max() < 0.06


@pytest.mark.parametrize("count", [5, 12, 54, 700])
def test_homography_is_the_shortest_vector_of_the_normalised_rows(count):
    rng = np.random.default_rng(count)
    src = rng.uniform(0, 400, (count, 2))
    dst = apply_homography(H, src) + rng.normal(0, 0.3, (count, 2))
    (p, T), (q, U) = (normalised(points) for points in (src, dst))
    one, zero = np.ones((count, 1)), np.zeros((count, 3))
    flat = np.concatenate([p, one], axis=1)
    rows = np.concatenate([
        np.concatenate([flat, zero, -q[:, :1] * flat], axis=1), np.concatenate([zero, flat, -q[:, 1:] * flat], axis=1),
    ])  # fmt: skip
    expected = np.linalg.inv(U) @ np.linalg.svd(rows)[2][-1].reshape(3, 3) @ T
    np.testing.assert_allclose(apply_homography(homography(src, dst), src), apply_homography(expected, src), atol=1e-9)


def normalised(points):
    """Points about 0 at a mean distance of √2, and the matrix that takes them there."""
    middle = points.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(points - middle, axis=1).mean()
    return (points - middle) * scale, np.array(
        [[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1]]
    )


def test_homography_of_points_that_are_not_finite():
    src = np.random.default_rng(1).uniform(0, 400, (9, 2))
    for bad in (np.nan, np.inf):
        dst = src.copy()
        dst[4, 1] = bad
        with pytest.raises(np.linalg.LinAlgError, match="finite"):
            homography(src, dst)


@pytest.mark.parametrize(("n", "m", "width"), [(3, 3, 2), (4, 5, 2), (5, 5, 3)])
def test_homography_refuses(n, m, width):
    with pytest.raises(RcdnError, match="homography"):
        homography(np.ones((n, width)), np.ones((m, width)))


def test_transform():
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.1, -0.7, 0.4]))[0]
    T[:3, 3] = 1, 2, 3
    points = np.random.default_rng(0).normal(size=(2, 5, 3))
    homogeneous = np.concatenate([points, np.ones((2, 5, 1))], axis=-1)
    assert transform(Pose(T), points) == pytest.approx((homogeneous @ T.T)[..., :3])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_points_are_in_front_of_a_horizon_whatever_the_sign_of_its_homography(sign):
    H = sign * np.array([[1.0, 0, 0], [0, 1, 0], [0, -0.01, 1]])  # its horizon is y = 100
    here, far, behind = np.array([[0.0, 0], [9, 50]]), np.array([[0.0, 0], [9, 95]]), np.array([[0.0, 0], [9, 120]])
    assert depths(H, here) == pytest.approx(sign * np.array([1, 0.5]))
    assert [in_front(H, xy, 0.1) for xy in (here, far, behind)] == [True, False, False]
    assert in_front(H, far, 0.04)
    assert in_front(H, behind[1:], 0.1)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-3, 0.7, np.pi, 5.0, 1e3, 1e7])
def test_rotations_are_those_of_opencv(angle):
    axes = np.random.default_rng(3).normal(size=(2, 5, 3))
    vectors = angle * axes / np.linalg.norm(axes, axis=-1, keepdims=True)
    R = rotation(vectors)
    assert R.shape == (2, 5, 3, 3)
    for v, found in zip(vectors.reshape(-1, 3), R.reshape(-1, 3, 3), strict=True):
        assert found == pytest.approx(cv2.Rodrigues(v)[0], abs=1e-15 + 1e-15 * angle)
    assert R @ R.swapaxes(-1, -2) == pytest.approx(np.broadcast_to(np.eye(3), R.shape), abs=1e-14)
    assert rotation(vectors[0, 0]).shape == (3, 3)
    assert rotation(np.zeros((0, 3))).shape == (0, 3, 3)
