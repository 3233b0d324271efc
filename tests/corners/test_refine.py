"""Sub-pixel refinement on rendered corners with exact truth."""

import time
import warnings
from typing import get_args

import cv2
import numpy as np
import pytest
from corner_scene import board, render
from scipy.ndimage import gaussian_filter

from rcdn.config import Refine, RefineMethod
from rcdn.corners.adaptive import adaptive_fit, nearest_pitch
from rcdn.corners.refine import com_offset, edge_position, mix, parabola_offset, peak_offset, refine
from rcdn.corners.saddle import rochade, smooth_fit, surface_fit, surface_fits
from rcdn.corners.symmetry import symmetry_centre
from rcdn.errors import RcdnError
from rcdn.types import Status

METHODS = get_args(RefineMethod)


def bumps(truth, shape, sigma=1.2):
    """Gaussian response map with peaks at `truth`."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    out = np.zeros(shape)
    for u, v in truth:
        out = np.maximum(out, np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma**2)))
    return out.astype(np.float32)


def distances(position, images=3, **scene):
    """Errors, px, of `position(grey, seeds)` from seeds up to ±0.7 px (and rounding) off; NaN where it failed."""
    out = []
    for seed in range(images):
        rng = np.random.default_rng(seed + 50)
        turn, axis = rng.uniform(0, np.pi / 2), rng.uniform(0, np.pi)
        grey, truth, _ = board(turn=turn, axis=axis, seed=seed, **scene)
        seeds = np.rint(truth + rng.uniform(-0.7, 0.7, truth.shape)).astype(int)
        out.append(np.hypot(*(position(grey, seeds) - truth).T))
    return np.concatenate(out)


@pytest.mark.parametrize(
    ("scene", "floor"),
    [
        ({"pitch": 20, "noise": 0}, 0.007),
        ({"pitch": 20, "noise": 10}, 0.055),
        ({"pitch": 20, "noise": 40}, 0.22),
        ({"pitch": 20, "blur": 4.0}, 0.008),
        ({"pitch": 20, "blur": 4.0, "noise": 10}, 0.13),
        ({"pitch": 20, "noise": 10, "tilt": np.radians(60)}, 0.085),
        ({"pitch": 6, "blur": 0.7}, 0.015),
        ({"pitch": 9, "noise": 10}, 0.075),
        ({"pitch": 40}, 0.007),
        ({"pitch": 40, "noise": 10}, 0.055),
        ({"pitch": 40, "tilt": np.radians(70)}, 0.02),
        ({"pitch": 40, "barrel": 0.3}, 0.06),
    ],
)
def test_adaptive_mean_error(scene, floor):
    """Floors are about 15 % above what was measured; no corner may be lost."""
    error = distances(adaptive_fit, **scene)
    assert error.max() < 2
    assert error.mean() < floor


def test_paper_fit_is_precise_on_clean_corners_and_twice_worse_in_noise():
    paper = lambda grey, seeds: surface_fit(grey, seeds, rochade(2))  # noqa: E731
    assert 0.02 < distances(paper, pitch=20).mean() < 0.06
    assert distances(paper, pitch=20, noise=10).mean() < 0.11
    assert distances(adaptive_fit, pitch=20, noise=10).mean() < 0.65 * distances(paper, pitch=20, noise=10).mean()


def test_symmetry_reaches_the_bound_in_noise():
    """Cramér–Rao of the crossing of two edges of known blur over a disc: information C² / (2 √π σ n²) a px of edge."""
    half, noise, contrast, blur = 8, 10.0, 127.0, np.hypot(1.0, 12**-0.5)
    bound = np.sqrt(noise**2 * 2 * np.sqrt(np.pi) * blur / contrast**2 / (2 * half + 1)) * np.sqrt(np.pi / 2)
    error = distances(lambda grey, seeds: symmetry_centre(grey, seeds, half), pitch=20, noise=noise, images=6)
    assert bound < np.nanmean(error) < 1.2 * bound
    assert np.isnan(error).mean() < 0.05


def test_symmetry_of_an_edge_has_no_centre():
    grey = render(lambda xy: xy[..., 0] + 0.3 * xy[..., 1] > 27.3, (40, 40))
    assert np.isnan(symmetry_centre(grey, np.array([[21.0, 20.0]]), 6)).all()
    assert np.isnan(symmetry_centre(np.full((40, 40), 9, np.uint8), np.array([[21.0, 20.0]]), 6)).all()


def test_edge_method_on_clean_corners():
    assert distances(edge_position, pitch=20).mean() < 0.04


def test_paper_fit_equals_filter_then_least_squares():
    """The combined matrix against cone filter, window and lstsq written out."""
    grey, truth, _ = board(pitch=20, noise=5)
    x0, y0 = seed = np.rint(truth[10]).astype(int)
    reach = np.arange(-2, 3)
    cone = np.maximum(0, 3 - np.hypot(reach[:, None], reach))
    smooth = cv2.filter2D(grey.astype(np.float64), -1, cone / cone.sum())
    y, x = (v.ravel() for v in np.mgrid[-2:3, -2:3])
    window = smooth[y0 - 2 : y0 + 3, x0 - 2 : x0 + 3].ravel()
    basis = np.stack((x * x, x * y, y * y, x, y, np.ones(25)), axis=1)
    a1, a2, a3, a4, a5, _ = np.linalg.lstsq(basis, window, rcond=None)[0]
    saddle = np.linalg.solve([[2 * a1, a2], [a2, 2 * a3]], [-a4, -a5])
    assert np.abs(saddle).max() < 1  # no second fit
    np.testing.assert_allclose(surface_fit(grey, seed[None], rochade(2))[0], seed + saddle, atol=1e-8)


@pytest.mark.parametrize("half", [2, 4, 8])
def test_smooth_fit_equals_blur_then_weighted_least_squares(half):
    """The combined matrix against its two steps written out, at seeds where the window needn't move."""
    grey, truth, _ = board(pitch=30, noise=5)
    seeds = np.rint(truth).astype(int)
    found = surface_fit(grey, seeds, smooth_fit(half))
    near = (np.abs(found - seeds) < 0.5).all(axis=1)
    assert near.sum() > 20
    sigma = max(0.7, 0.35 * half)
    grow = int(np.ceil(3 * sigma))
    smooth = gaussian_filter(grey.astype(float), sigma, mode="nearest", radius=grow)
    y, x = (v.ravel() for v in np.mgrid[-half : half + 1, -half : half + 1])
    root = np.exp(-(x**2 + y**2) / (4 * (0.5 * half) ** 2))[:, None]
    basis = np.stack((x * x, x * y, y * y, x, y, np.ones(len(x))), axis=1) * root
    for (x0, y0), xy in zip(seeds[near], found[near], strict=True):
        window = smooth[y0 - half : y0 + half + 1, x0 - half : x0 + half + 1].reshape(-1, 1) * root
        a1, a2, a3, a4, a5, _ = np.linalg.lstsq(basis, window[:, 0], rcond=None)[0]
        np.testing.assert_allclose(xy - (x0, y0), np.linalg.solve([[2 * a1, a2], [a2, 2 * a3]], [-a4, -a5]), atol=1e-6)


def test_each_corner_by_its_own_fit():
    grey, truth, _ = board(pitch=20, noise=10)
    seeds, fits = np.rint(truth).astype(int), (smooth_fit(3), rochade(2), smooth_fit(8))
    which = np.arange(len(seeds)) % 3
    found = surface_fits(grey, seeds, fits, which)
    for k, fit in enumerate(fits):
        np.testing.assert_array_equal(found[which == k], surface_fit(grey, seeds[which == k], fit))


@pytest.mark.parametrize("half", [None, 2])
def test_grey_scale_and_inversion_dont_matter(half):
    grey, truth, _ = board(pitch=20, noise=3)
    seeds = np.rint(truth).astype(int)
    rule = Refine("saddle", half)
    response = bumps(truth, grey.shape)
    xy, _ = refine(grey, response, seeds, rule)
    other, _ = refine(255 - 0.5 * grey.astype(np.float32), response, seeds, rule)
    np.testing.assert_allclose(other, xy, atol=2e-3)


@pytest.mark.parametrize("half", [None, 2])
def test_a_transposed_picture_has_transposed_corners(half):
    grey, truth, _ = board(pitch=20, noise=3)
    seeds, response, rule = np.rint(truth).astype(int), bumps(truth, grey.shape), Refine("saddle", half)
    xy, _ = refine(grey, response, seeds, rule)
    other, _ = refine(grey.T, response.T, seeds[:, ::-1], rule)
    np.testing.assert_allclose(other[:, ::-1], xy, atol=5e-3)


def test_gaussian_peak_is_exact_on_a_gaussian():
    truth = np.random.default_rng(0).uniform(8, 56, (1, 2)) + np.arange(3)[:, None] * [0.0, 0.13]
    for point in truth:
        peak = np.rint(point).astype(int)[None]
        np.testing.assert_allclose(peak + peak_offset(bumps([point], (64, 64)), peak), point[None], atol=1e-4)
        assert np.abs(peak + parabola_offset(bumps([point], (64, 64)), peak) - point).max() < 0.06
        assert np.abs(peak + com_offset(bumps([point], (64, 64)), peak) - point).max() < 0.02


def test_zero_neighbours_are_floored_at_one_percent():
    response = np.zeros((5, 5), np.float32)
    response[2, 1:4] = 0, 1, 0.5
    np.testing.assert_allclose(
        peak_offset(response, np.array([[2, 2]]))[0], [0.5 * np.log(0.02) / (np.log(0.01) + np.log(0.5)), 0]
    )


@pytest.mark.parametrize("seed", range(4))
def test_offsets_stay_within_half_a_pixel(seed):
    response = gaussian_filter(np.random.default_rng(seed).uniform(0, 1, (40, 40)), 1)
    peaks = np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2)
    for offset in (peak_offset(response, peaks), parabola_offset(response, peaks)):
        found = np.isfinite(offset).all(axis=1)
        assert found.sum() > 20
        assert np.abs(offset[found]).max() <= 0.5
        assert np.array_equal(np.isfinite(offset[:, 0]), np.isfinite(offset[:, 1]))


def test_mix():
    nan = [np.nan, np.nan]
    peak = np.array([[1.0, 1], [1, 1], [1, 1], nan, nan])
    saddle = np.array([[1.5, 1], [3, 1], nan, [2, 2], nan])
    assert np.array_equal(mix(peak, saddle), [[1.25, 1], [1, 1], [1, 1], [2, 2], nan], equal_nan=True)


@pytest.mark.parametrize("method", METHODS)
def test_no_failure_on_a_clean_board(method):
    grey, truth, _ = board(pitch=20)
    xy, status = refine(grey, bumps(truth, grey.shape), np.rint(truth).astype(int), Refine(method))
    assert (status == Status.REFINED).all()
    assert np.hypot(*(xy - truth).T).mean() < 0.05
    assert xy.dtype == np.float64
    assert status.dtype == np.uint8


@pytest.mark.parametrize("half", [None, 2, 5])
@pytest.mark.parametrize("method", METHODS)
def test_failure_returns_the_seed_and_says_so(method, half):
    """Flat picture, flat response: nothing to refine on."""
    seeds = np.array([[0, 0], [10, 12], [39, 29]])
    flat = np.full((30, 40), 90, np.uint8)
    xy, status = refine(flat, np.zeros((30, 40), np.float32), seeds, Refine(method, half))
    assert np.array_equal(xy, seeds)
    assert (status == Status.SEED).all()


@pytest.mark.parametrize("half", [None, 2])
def test_a_straight_edge_is_no_saddle(half):
    grey = render(lambda xy: xy[..., 0] + 0.3 * xy[..., 1] > 27.3, (40, 40))
    seeds = np.array([[21, 20], [22, 19], [20, 24]])
    xy, status = refine(grey, np.zeros((40, 40), np.float32), seeds, Refine("saddle", half))
    assert (status == Status.SEED).all()
    assert np.array_equal(xy, seeds)


def test_an_edge_in_noise_is_no_saddle():
    """Noise bends a straight edge, but the saddle of such a fit lies far outside its window."""
    grey = render(lambda xy: xy[..., 0] + 0.3 * xy[..., 1] > 60.3, (100, 100), noise=15)
    y = np.arange(15, 85)
    seeds = np.stack((np.rint(60.3 - 0.3 * y).astype(int), y), axis=1)
    assert np.isfinite(surface_fit(grey, seeds, smooth_fit(8))).all(axis=1).mean() < 0.02


@pytest.mark.parametrize("size", [(1, 1), (2, 7), (5, 5), (30, 40)])
@pytest.mark.parametrize("method", METHODS)
def test_seeds_at_the_border_never_crash(method, size):
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, size).astype(np.uint8)
    seeds = np.stack(np.meshgrid([0, size[1] - 1], [0, size[0] - 1]), axis=-1).reshape(-1, 2)
    response = rng.uniform(0, 1, size).astype(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for half in (None, 2):
            xy, status = refine(grey, response, seeds, Refine(method, half))
            assert np.isfinite(xy).all()
            assert np.array_equal(xy[status == Status.SEED], seeds[status == Status.SEED])


def test_no_corners_and_one_corner():
    grey, truth, _ = board(pitch=20)
    response = bumps(truth, grey.shape)
    xy, status = refine(grey, response, np.zeros((0, 2), int), Refine())
    assert xy.shape == (0, 2)
    assert status.shape == (0,)
    xy, status = refine(grey, response, np.rint(truth[:1]).astype(int), Refine())
    assert status.tolist() == [Status.REFINED]
    assert np.hypot(*(xy - truth[:1]).T) < 0.02
    assert nearest_pitch(truth[:1]).tolist() == [20.0]


def test_shapes_that_dont_match_are_refused():
    with pytest.raises(RcdnError, match="one shape"):
        refine(np.zeros((4, 5), np.uint8), np.zeros((5, 4), np.float32), np.zeros((1, 2)), Refine())


def test_every_corner_by_itself_equals_all_at_once():
    grey, truth, _ = board(pitch=13, noise=10, tilt=0.7)
    seeds, pitch = np.rint(truth).astype(int), nearest_pitch(truth)
    together = adaptive_fit(grey, seeds, pitch)
    alone = np.concatenate([adaptive_fit(grey, seeds[k : k + 1], pitch[k : k + 1]) for k in range(len(seeds))])
    np.testing.assert_allclose(alone, together, atol=1e-4)


def test_many_corners_stay_quick():
    grey, truth, _ = board(pitch=20, noise=10)
    seeds = np.tile(np.rint(truth).astype(int), (41, 1))  # 2009 corners
    start = time.process_time()
    adaptive_fit(grey, seeds, np.full(len(seeds), 20.0))
    assert time.process_time() - start < 1.5
