"""Edge directions on rendered corners at every angle, and what isn't a corner."""

import cv2
import numpy as np
import pytest
from corner_scene import board, render
from scipy.spatial import cKDTree
from scipy.special import erf

from rcdn.corners.orientation import axes
from rcdn.corners.peaks import axes_of


def turned(a, b):
    """Smallest difference of two undirected angles, radians."""
    return np.abs((a - b + np.pi / 2) % np.pi - np.pi / 2)


def scan(images=6, offset=0.3, **scene):
    """Errors (N, 2) of the axes, degrees (NaN: none), and `fit` over boards turned at random."""
    errors, fits = [], []
    for seed in range(images):
        rng = np.random.default_rng(seed)
        turn, axis = rng.uniform(0, np.pi / 2), rng.uniform(0, np.pi)
        grey, xy, edges = board(turn=turn, axis=axis, seed=seed, **scene)
        pitch = cKDTree(xy).query(xy, k=2)[0][:, 1]
        found = axes(grey, xy + rng.uniform(-offset, offset, xy.shape), np.clip(0.35 * pitch, 3, 10))
        truth = np.arctan2(edges[..., 1], edges[..., 0]) % np.pi
        pairs = np.stack([turned(found.axes, truth), turned(found.axes, truth[:, ::-1])])
        best = pairs.sum(axis=2).argmin(axis=0)
        errors.append(pairs[best, np.arange(len(xy))])
        fits.append(found.fit)
    return np.degrees(np.concatenate(errors)), np.concatenate(fits)


@pytest.mark.parametrize(
    ("scene", "mean", "worst5"),
    [
        ({"pitch": 20}, 0.06, 0.15),
        ({"pitch": 20, "noise": 10}, 0.5, 1.3),
        ({"pitch": 20, "noise": 40}, 2.0, 5),
        ({"pitch": 20, "blur": 4.0, "noise": 10}, 1.9, 4.5),
        ({"pitch": 9, "noise": 10}, 2.0, 5),
        ({"pitch": 20, "noise": 10, "tilt": np.radians(60)}, 1.6, 4.5),
        ({"pitch": 40, "tilt": np.radians(75)}, 0.75, 3.8),
        ({"pitch": 40, "noise": 10, "tilt": np.radians(75)}, 1.5, 4.8),
    ],
)
def test_axes_error(scene, mean, worst5):
    error, fit = scan(**scene)
    assert np.isfinite(error).all()
    assert error.mean() < mean
    assert np.percentile(error, 95) < worst5
    assert np.percentile(fit, 5) > 0.6


@pytest.mark.parametrize(("blur", "start"), [(0.8, 5), (1.5, 10), (3.0, 20)])
def test_model_recovers_its_own_axes(blur, start):
    """Pictures made by the model, sectors from 25°; the sectors alone are off by more than `start` degrees."""
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, np.pi, (50, 1)) + np.column_stack((np.zeros(50), np.radians(rng.uniform(25, 155, 50))))
    y, x = np.mgrid[-12:13, -12:13].astype(float)
    errors = {True: [], False: []}
    for two in truth:
        d = [y * np.cos(a) - x * np.sin(a) for a in two]
        grey = 90 - 40 * erf(d[0] / np.sqrt(2) / blur) * erf(d[1] / np.sqrt(2) / blur)
        for careful, found in errors.items():
            own = axes(grey, np.array([[12.0, 12.0]]), 5.0, np.array([careful])).axes[0]
            found.append(min((turned(own, two), turned(own, two[::-1])), key=np.sum))
    assert np.degrees(errors[True]).mean() < 0.22
    assert np.degrees(errors[True]).max() < 0.65
    assert np.degrees(errors[False]).max() > start


@pytest.mark.parametrize("turn", np.radians(np.arange(0, 180, 7.5)))
def test_polarity_contrast_and_order_at_every_angle(turn):
    """Board colours are known: a square with an even sum of coordinates is bright."""
    grey, xy, _ = board(pitch=24, turn=turn)
    found = axes(grey, xy, 8.0)
    assert (found.axes[:, 0] < found.axes[:, 1]).all()
    assert (found.axes >= 0).all()
    assert (found.axes < np.pi).all()
    middle = found.axes.mean(axis=1)
    ahead = np.rint(xy + 6 * np.stack((np.cos(middle), np.sin(middle)), axis=1)).astype(int)
    bright = grey[ahead[:, 1], ahead[:, 0]] > 127
    assert np.array_equal(found.polarity == 1, bright)
    assert set(np.unique(found.polarity)) == {-1, 1}
    assert np.abs(found.contrast - 115).max() < 15


def test_inversion_flips_polarity_only():
    grey, xy, _ = board(pitch=20, noise=5)
    one, other = axes(grey, xy, 7.0), axes(255 - grey, xy, 7.0)
    assert np.array_equal(one.polarity, -other.polarity)
    np.testing.assert_allclose(one.axes, other.axes, atol=1e-6)
    np.testing.assert_allclose(one.contrast, other.contrast, rtol=1e-5)


def test_quarter_turn_of_the_picture_turns_the_axes():
    grey, xy, _ = board(pitch=20, noise=5, turn=0.4)
    one = axes(grey, xy, 7.0)
    turned_xy = np.stack((grey.shape[0] - 1 - xy[:, 1], xy[:, 0]), axis=1)
    other = axes(np.rot90(grey, -1), turned_xy, 7.0)
    expected = np.sort((one.axes + np.pi / 2) % np.pi, axis=1)
    assert turned(other.axes, expected).max() < np.radians(1)
    # one axis crosses the seam at π, so the sector between the sorted axes is the other one
    assert np.array_equal(one.polarity, -other.polarity)


def test_contrast_and_fit_under_gain():
    grey, xy, _ = board(pitch=20, noise=5)
    one, other = axes(grey.astype(np.float32), xy, 7.0), axes(grey.astype(np.float32) * 0.25 + 40, xy, 7.0)
    np.testing.assert_allclose(other.contrast, 0.25 * one.contrast, rtol=1e-4)
    np.testing.assert_allclose(other.fit, one.fit, atol=1e-4)


def junction(kind):
    def colour(xy):
        x, y = xy[..., 0] - 20.2, xy[..., 1] - 19.7
        x, y = 0.9 * x - 0.435 * y, 0.435 * x + 0.9 * y
        left, top = x < 0, y < 0
        return {
            "edge": left,
            "L": left & top,
            "T": np.where(top, 0.0, np.where(left, 1.0, 0.5)),
            "flat": np.zeros_like(x),
        }[kind]

    return colour


@pytest.mark.parametrize(("kind", "most"), [("edge", 0.05), ("L", 0.4), ("T", 0.25), ("flat", 0.0)])
def test_other_junctions_fit_badly(kind, most):
    """An X-corner in this noise has 0.85."""
    grey = render(junction(kind), (40, 40), noise=0 if kind == "flat" else 5)
    found = axes(grey, np.array([[20.2, 19.7]]), 7.0)
    assert found.fit[0] <= most
    if kind != "L":
        assert np.isnan(found.axes).all() or kind == "T"
    if kind in ("edge", "flat"):
        assert found.polarity[0] == 0


def test_sloppy_positions_are_forgiven():
    error, _ = scan(pitch=20, noise=10, offset=0.7)
    assert error.mean() < 0.6


@pytest.mark.parametrize("size", [(1, 1), (3, 9), (20, 20)])
def test_border_and_tiny_pictures(size):
    grey = np.random.default_rng(0).integers(0, 256, size).astype(np.uint8)
    xy = np.array([[0.0, 0], [size[1] - 1, size[0] - 1], [-5, 3]])
    found = axes(grey, xy, np.full(3, 5.0))
    assert found.axes.shape == (3, 2)
    assert np.isfinite(found.fit).all()
    assert ((found.fit >= 0) & (found.fit <= 1)).all()
    assert np.array_equal(found.polarity == 0, np.isnan(found.axes).any(axis=1))


@pytest.mark.parametrize("ratio", [0.5, 0.7, 0.8, 0.85])
def test_large_markers_beside_corners_leave_their_axes(ratio):
    """Rings of .35 of the pitch cross the larger ones, and show no X-corner there."""
    side, gap = 40, round(40 * (1 - ratio) / 2)
    grey = np.kron(np.indices((7, 7)).sum(axis=0) % 2, np.full((side, side), 200)).astype(np.uint8) + 20
    for row, column in zip(*np.nonzero(np.indices((7, 7)).sum(axis=0) % 2), strict=True):
        y, x = row * side + gap, column * side + gap
        grey[y : y + side - 2 * gap, x : x + side - 2 * gap] = 20
    xy = np.indices((6, 6)).reshape(2, -1).T[:, ::-1] * side + side - 0.5
    grey = cv2.GaussianBlur(grey, (0, 0), 0.7)
    found = axes_of(grey, xy, np.full(len(xy), float(side)))
    assert np.degrees(turned(np.sort(turned(found.axes, 0.0)), [0.0, np.pi / 2])).max() < 6
    assert (found.fit > 0.5).all()
    bright = (np.arange(36) // 6 + np.arange(36) % 6) % 2 == 1
    first_is_0 = turned(found.axes[:, 0], 0.0) < 0.1
    assert (found.polarity == np.where(bright == first_is_0, 1, -1)).all()


def test_no_corners():
    found = axes(np.zeros((5, 5), np.uint8), np.zeros((0, 2)), np.zeros(0))
    assert found.axes.shape == (0, 2)
    assert found.fit.shape == found.contrast.shape == found.polarity.shape == (0,)
