"""A board's smoothness, shared: gains on flat boards, retreat on uneven ones, no smear from a wrong corner."""

import numpy as np
import pytest

from rcdn.geometry import apply_homography
from rcdn.precision.smooth import smooth

H = np.array([[28.0, 4.0, 120.0], [-3.0, 25.0, 90.0], [0.012, 0.006, 1.0]])
SIGMA = 0.05


def flat(cols=9, rows=6):
    ij = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)
    return ij, apply_homography(H, ij.astype(float))


def measured(xy, seed, sigma=SIGMA):
    noise = np.random.default_rng(seed).normal(0, sigma, xy.shape)
    return xy + noise, np.tile(sigma**2 * np.eye(2), (len(xy), 1, 1))


def rms(off):
    return float(np.sqrt((off**2).mean()))


def test_a_flat_board_has_eight_degrees_of_freedom():
    ij, xy = flat()
    off, sigmas = [], []
    for seed in range(12):
        seen, cov = measured(xy, seed)
        moved, post = smooth(ij, seen, cov, np.ones(len(ij), bool))
        off.append(moved - xy)
        sigmas.append(np.sqrt(np.trace(post, axis1=1, axis2=2) / 2))
    share = rms(np.concatenate(off)) / SIGMA
    assert share < 1.35 * np.sqrt(8 / (2 * len(ij)))
    assert 0.75 < rms(np.concatenate(off) / np.concatenate(sigmas)[:, None]) < 1.25


@pytest.mark.parametrize("rough", [0.1, 0.5])
def test_an_uneven_board_is_left_alone(rough):
    ij, xy = flat()
    true = xy + np.random.default_rng(5).normal(0, rough, xy.shape)
    alone, shared = [], []
    for seed in range(6):
        seen, cov = measured(true, seed)
        alone.append(seen - true)
        shared.append(smooth(ij, seen, cov, np.ones(len(ij), bool))[0] - true)
    assert rms(np.concatenate(shared)) < 1.05 * rms(np.concatenate(alone))


def test_a_lens_is_no_unevenness():
    ij, xy = flat(12, 9)
    middle = xy.mean(axis=0)
    r2 = ((xy - middle) ** 2).sum(axis=1, keepdims=True) / 200**2
    bent = middle + (xy - middle) * (1 - 0.15 * r2 + 0.02 * r2**2)
    share = []
    for seed in range(4):
        seen, cov = measured(bent, seed)
        share.append(rms(smooth(ij, seen, cov, np.ones(len(ij), bool))[0] - bent) / SIGMA)
    assert np.mean(share) < 0.6


def test_one_wrong_corner_pulls_nobody():
    ij, xy = flat()
    seen, cov = measured(xy, 3)
    clean = smooth(ij, seen, cov, np.ones(len(ij), bool))[0]
    seen[20] += [1.5, -1]
    moved, post = smooth(ij, seen, cov, np.ones(len(ij), bool))
    others = np.arange(len(ij)) != 20
    assert np.abs(moved - clean)[others].max() < 0.5 * SIGMA
    assert np.array_equal(moved[20], seen[20])
    assert np.sqrt(post[20, 0, 0]) > 0.5


def test_an_uncertain_corner_follows_its_neighbours():
    ij, xy = flat()
    seen, cov = measured(xy, 4)
    seen[20] += [0.4, 0.4]
    cov[20] *= 100
    moved, post = smooth(ij, seen, cov, np.ones(len(ij), bool))
    assert np.linalg.norm(moved[20] - xy[20]) < 0.08
    assert post[20, 0, 0] < 0.1 * cov[20, 0, 0]


def test_corners_that_are_not_trusted_and_small_boards_stay():
    ij, xy = flat()
    seen, cov = measured(xy, 6)
    trusted = np.arange(len(ij)) != 7
    moved, post = smooth(ij, seen, cov, trusted)
    assert np.array_equal(moved[7], seen[7])
    assert np.array_equal(post[7], cov[7])
    small = (ij < 3).all(axis=1)
    moved, post = smooth(ij[small], seen[small], cov[small], np.ones(9, bool))
    assert np.array_equal(moved, seen[small])
    assert np.array_equal(post, cov[small])
