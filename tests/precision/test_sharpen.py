"""Corners of a known board, fitted again: errors against truth and against the Cramér–Rao bound,
honest sigmas, failures."""

from dataclasses import replace

import numpy as np
import pytest
from sharp_scene import SIZE, board_of, bound, example, scene

from rcdn import precision
from rcdn.precision import sharpen
from rcdn.synthetic import Bend, Cover, Light, render, truth

RAYLEIGH = np.sqrt(np.pi / 2)
"""mean length of a 2-D error, standard deviations an axis"""


def errors(geometry, seeds, **settings):
    """Errors (N, 2) px and sigmas (N,) of several boards."""
    off, sigma = [], []
    for seed in seeds:
        grey, board, xy = example(seed, **settings)
        sharp = sharpen(grey, board, geometry)
        off.append(sharp.xy - xy)
        sigma.append(sharp.sigma)
    return np.concatenate(off), np.concatenate(sigma)


def mean_length(off):
    return float(np.hypot(*off.T).mean())


@pytest.mark.parametrize(("noise", "blur"), [(5, 0.7), (20, 0.7), (40, 0.7), (10, 1.5), (10, 3.0)])
def test_one_corner_by_itself_comes_close_to_the_bound(noise, blur):
    shares = []
    for seed in range(3):
        grey, board, xy = example(seed, noise=noise, blur=blur, tilt=25)
        limit = bound(render(scene(seed, noise=0, blur=blur, tilt=25)), board_of(xy, board.ij), noise)
        error = np.hypot(*(sharpen(grey, board, geometry=False).xy - xy).T)
        shares.append(error / (RAYLEIGH * limit))
    assert 0.85 < np.nanmean(np.concatenate(shares)) < 1.15


@pytest.mark.parametrize(("noise", "limit"), [(10, 0.45), (20, 0.45), (40, 0.5)])
def test_flat_boards_go_below_the_one_corner_bound(noise, limit):
    shares = []
    for seed in range(4):
        grey, board, xy = example(seed, noise=noise, tilt=40)
        one = bound(render(scene(seed, noise=0, tilt=40)), board_of(xy, board.ij), noise)
        shares.append(np.hypot(*(sharpen(grey, board).xy - xy).T) / (RAYLEIGH * one))
    assert np.nanmean(np.concatenate(shares)) < limit


@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        ({"noise": 0}, 0.011),
        ({"noise": 3, "blur": 3}, 0.026),
        ({"noise": 3, "tilt": 60}, 0.018),
        ({"noise": 3, "pitch": 9}, 0.020),
        ({"noise": 3, "bleed": 0.04}, 0.013),
        ({"noise": 3, "gamma": 2.0, "blur": 1.2}, 0.015),
        ({"noise": 3, "motion": 5.0, "motion_angle": 0.5}, 0.017),
        ({"noise": 3, "light": Light(gx=1.5, gy=-1), "gain": 0.6}, 0.022),
    ],
)
def test_no_setting_leaves_a_bias(settings, limit):
    off, sigma = errors(False, range(3), **settings)
    assert mean_length(off) < limit
    assert (np.abs(off.mean(axis=0)) < 0.001 + 3 * sigma.mean() / np.sqrt(len(off))).all()


@pytest.mark.parametrize(
    ("settings", "least", "most"),
    [
        ({"noise": 3}, 0.88, 1.14),
        ({"noise": 20, "tilt": 50}, 0.88, 1.14),
        ({"noise": 8, "blur": 2.0}, 0.88, 1.15),
        ({"noise": 4, "pitch": 35, "blur": 1.2}, 0.88, 1.15),
        ({"noise": 4, "jpeg": 40}, 0.85, 1.25),
        ({"noise": 8, "smooth": 0.6}, 0.85, 1.3),
    ],
)
def test_sigma_is_honest_without_geometry(settings, least, most):
    off, sigma = errors(False, range(20, 24), **settings)
    assert least < np.sqrt(((off / sigma[:, None]) ** 2).mean()) < most


def test_sigma_is_honest_with_geometry():
    """A flat board has eight degrees of freedom: it takes many boards to tell."""
    off, sigma = errors(True, range(40, 56), noise=20, tilt=30)
    assert 0.8 < np.sqrt(((off / sigma[:, None]) ** 2).mean()) < 1.2


@pytest.mark.parametrize("noise", [3, 20])
@pytest.mark.parametrize("bend", [Bend(0.12, angle=0.4), Bend(0, 0.15, 5, 1, 0.8), Bend(0, 0.05, 3.2, 2, 2.0)])
def test_geometry_does_no_harm_to_bent_boards(bend, noise):
    alone = mean_length(errors(False, range(3), noise=noise, bend=bend, tilt=30)[0])
    assert mean_length(errors(True, range(3), noise=noise, bend=bend, tilt=30)[0]) < 1.02 * alone


def test_a_shadow_edge_neither_moves_nor_flatters_corners():
    shade = Cover(0, 160, 420, 170, 40, value=0.4, soft=6)
    off, sigma = errors(True, range(3), light=Light(shadows=(shade,)))
    assert np.percentile(np.hypot(*off.T), 98) < 0.05
    assert np.sqrt(((off / sigma[:, None]) ** 2).mean()) < 1.3


def covered(seed, corner, radius):
    """An example with a disc over one corner, in the middle of it; its position is as given."""
    spec = scene(seed)
    at = truth(spec)[0].xy[corner]
    grey = render(scene(seed, covers=(Cover(*at, *(at + 0.1), radius, value=0.4),)))
    _, board, xy = example(seed)
    return grey, board, xy


def test_a_covered_corner_stays_and_says_so():
    grey, board, xy = covered(3, 22, 14)
    sharp = sharpen(grey, board, geometry=False)
    others = np.arange(len(board)) != 22
    near = np.hypot(*(xy - xy[22]).T) > 45
    assert np.array_equal(sharp.xy[22], board.xy[22])
    assert sharp.sigma[22] > 2.5 * np.median(sharp.sigma)
    assert np.hypot(*(sharp.xy - xy)[others & near].T).max() < 0.04


@pytest.mark.parametrize("corner", [13, 22, 40])
@pytest.mark.parametrize("seed", [3, 4])
def test_the_board_says_where_a_covered_corner_is(corner, seed):
    grey, board, xy = covered(seed, corner, 9)
    wrong = np.where(np.arange(len(board))[:, None] == corner, board.xy + np.array([2.5, -1.5]), board.xy)
    sharp = sharpen(grey, board_of(wrong, board.ij))
    assert np.linalg.norm(sharp.xy[corner] - xy[corner]) < 0.03
    assert sharp.sigma[corner] < 0.05


@pytest.mark.parametrize("tail", [1, 2, 3])
def test_a_row_that_hangs_on_the_board_by_its_end_is_fitted_with_it(tail):
    """Corners whose neighbours lie on one line: what is left of a row behind a cover."""
    grey, board, xy = example(7, noise=2)
    keep = (board.ij[:, 0] < 9 - tail) | (board.ij[:, 1] == 3)
    sharp = sharpen(grey, board_of(board.xy[keep], board.ij[keep]))
    assert np.hypot(*(sharp.xy - xy[keep]).T).max() < 0.03
    assert (sharp.sigma < 0.03).all()


def test_a_half_covered_corner_is_less_certain():
    spec = scene(5)
    at = truth(spec)[0].xy[30]
    grey = render(scene(5, covers=(Cover(*(at + 7), *(at + 7.1), 8, value=0.1),)))
    _, board, xy = example(5)
    sharp = sharpen(grey, board, geometry=False)
    assert np.linalg.norm(sharp.xy[30] - xy[30]) < 4 * sharp.sigma[30]
    assert sharp.sigma[30] > 1.5 * np.median(sharp.sigma)


@pytest.mark.parametrize("geometry", [False, True])
def test_the_board_keeps_its_corners_labels_and_size(geometry):
    grey, board, _ = example(1)
    sharp = sharpen(grey, board, geometry)
    assert np.array_equal(sharp.ij, board.ij)
    assert np.array_equal(sharp.status, board.status)
    assert sharp.image_size == board.image_size
    assert sharp.sigma.shape == (len(board),)
    assert (sharp.sigma > 0).all()
    again = sharpen(grey, board, geometry)
    assert sharp.xy.tobytes() == again.xy.tobytes()
    assert sharp.sigma.tobytes() == again.sigma.tobytes()


def test_transposed_and_negative_pictures_have_the_same_corners():
    grey, board, _ = example(2, noise=8)
    sharp = sharpen(grey, board)
    turned = sharpen(np.ascontiguousarray(grey.T), board_of(board.xy[:, ::-1], board.ij, SIZE[::-1]))
    np.testing.assert_allclose(turned.xy[:, ::-1], sharp.xy, atol=1e-3)
    np.testing.assert_allclose(turned.sigma, sharp.sigma, rtol=0.05)
    negative = sharpen(255 - grey, board)
    np.testing.assert_allclose(negative.xy, sharp.xy, atol=1e-3)


@pytest.mark.parametrize("labels", [(slice(0, 1), slice(0, 6)), (slice(0, 2), slice(0, 2)), (slice(0, 3), slice(0, 3))])
def test_small_boards_are_no_trouble(labels):
    grey, board, xy = example(4)
    grid = np.arange(54).reshape(6, 9)[labels].ravel()
    sharp = sharpen(grey, board_of(board.xy[grid], board.ij[grid]))
    assert np.isfinite(sharp.xy).all()
    if min(np.ptp(board.ij[grid], axis=0)) > 1:
        assert mean_length(sharp.xy - xy[grid]) < 0.02


def test_windows_that_leave_the_picture_and_empty_pictures_are_no_trouble():
    grey, board, xy = example(6)
    low, high = np.floor(xy.min(axis=0)).astype(int) - 3, np.ceil(xy.max(axis=0)).astype(int) + 4
    part = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
    cut = board_of(board.xy - low, board.ij, part.shape[::-1])
    assert mean_length(sharpen(part, cut).xy + low - xy) < 0.02
    for flat in (np.full(grey.shape, 90, np.uint8), np.zeros(grey.shape, np.float32)):
        sharp = sharpen(flat, board)
        assert np.array_equal(sharp.xy, board.xy)


def test_a_board_whose_map_folds_stays_as_it_was(monkeypatch):
    grey, board, _ = example(0, noise=3)

    def folds(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("rcdn.precision.fit_corners", folds)
    assert sharpen(grey, board) is board


@pytest.mark.parametrize(("steps", "row"), [((0.31, 0.1), 2), ((0.1, 0.1), 0), ((0.1, 0.1, 0.1), 0)])
@pytest.mark.parametrize("seed", range(4))
def test_neighbours_that_go_astray_together_are_told_by_where_they_were(seed, steps, row, monkeypatch):
    """Fits of neighbours that run off the same way, each of which makes the others' plausible; the first of them may be
    so far off that it is refused anyway."""
    grey, board, xy = example(seed, jitter=0.02, noise=2)
    some = [int(np.flatnonzero((board.ij == [3 + k, row]).all(axis=1))[0]) for k in range(len(steps))]
    along = xy[some[1]] - xy[some[0]]
    fits = precision.fit_corners(grey, board.ij, board.xy)
    moved = fits.xy.copy()
    moved[some] += np.multiply.outer(steps, along)
    monkeypatch.setattr(precision, "fit_corners", lambda *_: replace(fits, xy=moved))
    sharp = sharpen(grey, board, geometry=False)
    assert np.hypot(*(sharp.xy - xy).T).max() < 0.15
    assert (sharp.sigma[some] > 5 * np.median(sharp.sigma)).all()
