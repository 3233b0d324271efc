"""Differences of cameras: known ones come back, and what calibrations state of them holds."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.difference import _half, agreement, camera_difference, common_grid, difference, displacement
from rcdn.errors import CalibrationError, RcdnError
from rcdn.geometry import project, rotation, unproject
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

BROWN, PINHOLE = CAMERAS["brown"], CAMERAS["pinhole"]
DIVISION = Camera(BROWN.K, [-0.2], BROWN.image_size, "division")


def moved(camera, *change):
    """`camera` with its first parameters changed."""
    by = np.zeros(len(camera.parameters))
    by[: len(change)] = change
    return camera.with_parameters(camera.parameters + by)


@pytest.mark.parametrize("camera", [*CAMERAS.values(), DIVISION], ids=lambda c: c.model)
def test_a_camera_does_not_differ_from_itself(camera):
    found = camera_difference(camera, camera)
    assert found.rms == pytest.approx(0, abs=1e-8)
    assert found.angle == pytest.approx(0, abs=1e-8)


def test_the_vectors_are_where_the_second_camera_sees_the_rays_of_the_first():
    points = np.array([[100.0, 80], [320, 240], [500, 400], [200, 300]])
    vectors, turn = difference(BROWN, CAMERAS["rational"], points)
    seen = project(CAMERAS["rational"], unproject(BROWN, points) @ rotation(turn).T)
    assert vectors == pytest.approx(seen - points)


def test_the_rotation_makes_the_sum_of_squares_least():
    points = common_grid(BROWN, moved(BROWN, 5, 4, 6, -3))
    other = moved(BROWN, 5, 4, 6, -3)
    vectors, turn = difference(BROWN, other, points)
    for by in 1e-4 * np.vstack([np.eye(3), -np.eye(3)]):
        assert (displacement(BROWN, other, turn + by, points) ** 2).sum() > (vectors**2).sum()


def test_a_small_shift_of_the_principal_point_is_a_rotation():
    """In the middle of a long lens's frame the two do the same; what is left is of second order."""
    long = Camera([[8000, 0, 320], [0, 8000, 240], [0, 0, 1]], [], (640, 480), "pinhole")
    found = camera_difference(long, moved(long, 0, 0, 8.0))
    assert found.rotation == pytest.approx([0, -8 / 8000, 0], abs=1e-6)
    assert found.rms < 0.02


def test_a_longer_focal_length_pulls_away_from_the_middle():
    camera = Camera([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]], [], (640, 480), "pinhole")
    found = camera_difference(camera, moved(camera, 6, 6))
    assert found.angle < 1e-6
    assert found.vectors == pytest.approx(0.01 * (found.points - [319.5, 239.5]), abs=1e-6)


def test_a_fisheye_beyond_90_degrees_is_compared_too():
    wide = Camera([[150, 0, 322], [0, 149, 241], [0, 0, 1]], [0.02, -0.005, 0.001, -0.0002], (640, 480), "fisheye")
    points = np.array([[322.0, 241], [40, 241], [600, 241], [322, 20]])
    vectors, _ = difference(wide, moved(wide, 0.5, 0.5), points)
    assert np.isfinite(vectors).all()
    assert np.abs(vectors).max() < 1.5


def test_pixels_beyond_the_fold_have_no_difference():
    folded = Camera([[400, 0, 320], [0, 400, 240], [0, 0, 1]], [-0.9, 0, 0, 0], (640, 480), "brown")
    points = np.array([[x, y] for x in range(20, 640, 60) for y in range(20, 480, 60)], float)
    vectors, _ = difference(replace(folded, distortion=np.zeros(4)), folded, points)
    assert np.isnan(vectors[0]).all()
    known = np.isfinite(vectors).all(axis=1)
    assert known.sum() > 10
    assert np.hypot(*(points[known] - [320, 240]).T).max() < 243.5  # the fold is at 0.6086 focal lengths


def test_wrong_arguments_are_named():
    with pytest.raises(RcdnError, match=r"640×480 and 320×240"):
        difference(BROWN, replace(PINHOLE, image_size=(320, 240)), np.zeros((4, 2)))
    with pytest.raises(RcdnError, match="pixels must have shape"):
        difference(BROWN, PINHOLE, np.zeros((4, 3)))
    with pytest.raises(RcdnError, match="rays in common at 2 of 2"):
        difference(BROWN, PINHOLE, np.zeros((2, 2)))


def test_independent_calibrations_agree_as_often_as_they_state():
    """Of 7 pairs: the mean square of difference ÷ stated is 1, its probability uniform; and a changed lens is told."""
    found = [calibrate(random_boards(PINHOLE, seed, 20)[0], SPACING, model="pinhole") for seed in range(14)]
    pairs = [(a, b, camera_difference(a.camera, b.camera)) for a, b in zip(found[::2], found[1::2], strict=True)]
    agreements = [agreement(*pair) for pair in pairs]
    assert np.mean([t.rms**2 for t in agreements]) == pytest.approx(1, abs=0.5)
    assert 0.2 < np.mean([t.probability for t in agreements]) < 0.8
    assert sum(t.agree for t in agreements) >= 6  # each disagrees by chance in 5 % of cases
    assert all(t.expected > 1.2 for t in agreements)
    other = replace(found[1], camera=moved(found[1].camera, 12, 12))
    changed = agreement(found[0], other, camera_difference(found[0].camera, other.camera))
    assert not changed.agree
    assert changed.rms > changed.expected


def test_the_stated_deviation_is_that_of_many_repetitions():
    """Parameters drawn from the covariances of two calibrations: the differences scatter as the
    first-order deviation says."""
    rng = np.random.default_rng(5)
    one = calibrate(random_boards(BROWN, 3, 12)[0], SPACING, model="brown")
    cov, many = one.cov[:-6, :-6], 150
    drawn = rng.multivariate_normal(one.camera.parameters, cov, (many, 2))
    points = common_grid(one.camera, one.camera, 8)
    vectors = []
    for first, second in drawn:
        a, b = (one.camera.with_parameters(p) for p in (first, second))
        vectors.append(difference(a, b, points)[0])
    spread = np.sqrt((np.array(vectors) ** 2).mean(axis=(0, 2)))
    stated = agreement(one, one, camera_difference(one.camera, one.camera, points)).deviation
    assert stated == pytest.approx(spread, rel=0.2)


def test_a_covariance_that_rounding_makes_negative_is_one_and_no_other():
    """Those of smooth corrections have hundreds of parameters; some variances of their combinations are all but 0."""
    rng = np.random.default_rng(0)
    turn, size = np.linalg.qr(rng.normal(size=(40, 40)))[0], 10 ** rng.uniform(-6, 3, 40)

    def with_least(variance):
        correlation = turn * np.r_[variance, np.linspace(0.1, 2, 39)] @ turn.T
        return correlation * size * size[:, None]

    rounded = with_least(-2e-9)
    half = _half(rounded)
    assert np.abs((half @ half.T - rounded) / size / size[:, None]).max() < 1e-8
    held = np.zeros((41, 41))
    held[:40, :40] = rounded
    assert not _half(held)[40].any()
    for wrong in (with_least(-1e-3), np.diag([1, -1e-20, 2]), np.diag([1, np.inf]), np.full((3, 3), np.nan)):
        with pytest.raises(CalibrationError, match="negative or infinite variances"):
            _half(wrong)
