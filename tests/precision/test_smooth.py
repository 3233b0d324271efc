"""A board's smoothness, shared: gains on flat boards, retreat on uneven ones, no smear from a wrong corner."""

import numpy as np
import pytest

from rcdn.geometry import apply_homography
from rcdn.precision.smooth import DECAYS, FREE, ROUGH, WIDTHS, Evidence, likeliest, sheet_of, smooth

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


@pytest.mark.parametrize("wrong", [0.0, 5.0])
def test_a_covered_corner_gets_what_the_board_predicts(wrong):
    """Whether it isn't trusted or is an outlier; where it lies has no say."""
    ij, xy = flat()
    bad = np.isin(np.arange(len(ij)), (0, 22, 23))
    trusted = np.arange(len(ij)) != 22
    off, scaled = [], []
    for seed in range(12):
        seen, cov = measured(xy, seed)
        seen[23] += 2.0
        seen[[0, 22]] += wrong
        cov[[0, 22]] = np.eye(2)
        moved, post = smooth(ij, seen, cov, trusted, covered=bad)
        off.append((moved - xy)[bad])
        scaled.append(off[-1] / np.sqrt(post[bad, 0, 0])[:, None])
    assert rms(np.concatenate(off)) < SIGMA
    assert 0.6 < rms(np.concatenate(scaled)) < 1.2


@pytest.mark.parametrize("steps", [2, 3, 5, 8, 20])
def test_no_corner_goes_to_the_horizon(steps):
    """A board on its side, and a false corner beyond its rim, some of them beyond the horizon."""
    tilted = np.array([[28.0, 4.0, 120.0], [-3.0, 25.0, 90.0], [0.1, 0.006, 1.0]])
    ij, xy = flat()
    xy = apply_homography(tilted, ij)
    wrong = np.array([[-steps, 3]])
    ij, xy = np.concatenate([ij, wrong]), np.concatenate([xy, [[40.0, 240.0]]])
    seen, cov = measured(xy, 1, 0.02)
    last = np.arange(len(ij)) == len(ij) - 1
    cov[last] = 100 * np.eye(2)
    moved, _ = smooth(ij, seen, cov, ~last, covered=last)
    without, _ = smooth(ij[~last], seen[~last], cov[~last], np.ones(len(ij) - 1, bool))
    nearest = np.hypot(*(seen[~last] - seen[last]).T).min()
    assert np.linalg.norm(moved[last] - seen[last]) < nearest / 2
    assert np.array_equal(moved[~last], without)


def test_a_covered_corner_that_knows_better_stays():
    """A corner far outside, of which the board knows little."""
    ij, xy = flat()
    ij, xy = np.concatenate([ij, [[30, 3]]]), np.concatenate([xy, apply_homography(H, np.array([[30.0, 3.0]]))])
    seen, cov = measured(xy, 1)
    last = np.arange(len(ij)) == len(ij) - 1
    moved, post = smooth(ij, seen, cov, ~last, covered=last)
    assert np.array_equal(moved[last], seen[last])
    assert np.array_equal(post[last], cov[last])


@pytest.mark.parametrize(("count", "stay"), [(6, False), (30, True)])
def test_a_board_with_many_outliers_predicts_nothing(count, stay):
    ij, xy = flat(16, 12)
    seen, cov = measured(xy, 2)
    some = np.random.default_rng(3).permutation(len(ij)) < count
    seen[some] += np.random.default_rng(4).choice([-3.0, 3.0], (count, 2))
    moved, _ = smooth(ij, seen, cov, np.ones(len(ij), bool), covered=some)
    assert (np.hypot(*(moved - seen)[some].T) < 0.1).mean() == stay
    assert (np.hypot(*(moved - xy)[some].T) < 0.1).mean() == (not stay)


def board_of_all(seed, cols=9, rows=6):
    """A sheet with uneven and slanted errors, and dense matrices of what its kernels reckon with:
    design (2N, D), errors (2N, 2N)."""
    ij, xy = flat(cols, rows)
    rng = np.random.default_rng(seed)
    seen = xy + rng.normal(0, SIGMA, xy.shape) + 0.2 * np.sin(ij / 2)
    turn = rng.normal(0, SIGMA, (len(ij), 2, 2))
    cov = turn @ turn.swapaxes(1, 2) + 0.2 * SIGMA**2 * np.eye(2)
    base, sheet = sheet_of(ij, seen, cov)
    zero = 0 * sheet.bent
    bent = np.concatenate([np.stack([sheet.bent, zero], axis=1), np.stack([zero, sheet.bent], axis=1)], axis=2)
    design = np.concatenate([sheet.tangent, bent], axis=2).reshape(2 * len(ij), -1)
    errors = np.zeros((len(ij), 2, len(ij), 2))
    errors[np.arange(len(ij)), :, np.arange(len(ij))] = cov
    return ij, seen, cov, base, sheet, design, errors.reshape(2 * len(ij), -1)


def prior_of(sheet, spot, scale):
    bent = WIDTHS[spot[2]] * DECAYS[spot[1]] ** (sheet.degree - 2.0)
    return scale * np.concatenate([np.full(8, FREE), bent, bent])


@pytest.mark.parametrize("size", [(9, 6), (4, 4), (12, 11)])
def test_likelihoods_are_those_of_the_data_under_the_sheet(size):
    """Against the normal distribution of all data at once."""
    *_, sheet, design, errors = board_of_all(1, *size)
    evidence, spots = Evidence(sheet, SIGMA), [(0, 0, 0), (0, 3, 8), (2, 1, 4), (5, 2, 6)]
    off, expected = sheet.off.ravel(), []
    for spot in spots:
        both = (
            errors
            + (ROUGH[spot[0]] * SIGMA) ** 2 * np.eye(len(off))
            + (design * prior_of(sheet, spot, SIGMA) ** 2) @ design.T
        )
        expected.append(-0.5 * (off @ np.linalg.solve(both, off) + np.linalg.slogdet(both)[1]))
    np.testing.assert_allclose(evidence.log_likelihoods(spots), expected, rtol=1e-6)
    assert evidence.log_likelihoods(spots[:2]) == evidence.log_likelihoods(spots)[:2]


def test_few_polynomials_are_a_sheet_without_the_others():
    *_, sheet, design, errors = board_of_all(2)
    spot, terms = (2, 2, 5), 16
    root = prior_of(sheet, spot, SIGMA)
    root[8:].reshape(2, -1)[:, terms:] = 0
    off = sheet.off.ravel()
    both = errors + (ROUGH[spot[0]] * SIGMA) ** 2 * np.eye(len(off)) + (design * root**2) @ design.T
    expected = -0.5 * (off @ np.linalg.solve(both, off) + np.linalg.slogdet(both)[1])
    assert Evidence(sheet, SIGMA).judge([spot], terms)[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("size", [(9, 6), (15, 14)])
def test_positions_and_covariances_are_those_of_the_likeliest_sheet(size):
    """The mean and covariance of a normal distribution given all data; the larger board is reckoned in parts."""
    ij, seen, cov, base, sheet, design, errors = board_of_all(3, *size)
    scale = float(np.sqrt(np.median(np.trace(cov, axis1=1, axis2=2)) / 2))
    spot = likeliest(Evidence(sheet, scale))
    rough = (ROUGH[spot[0]] * scale) ** 2 * np.eye(len(design))
    truth = (design * prior_of(sheet, spot, scale) ** 2) @ design.T + rough
    gain = np.linalg.solve(truth + errors, truth).T
    moved, post = smooth(ij, seen, cov, np.ones(len(ij), bool))
    np.testing.assert_allclose(moved, base + (gain @ sheet.off.ravel()).reshape(-1, 2), atol=1e-5)
    left = (truth - gain @ truth).reshape(len(ij), 2, len(ij), 2)[np.arange(len(ij)), :, np.arange(len(ij))]
    np.testing.assert_allclose(post, left, atol=1e-5 * SIGMA**2)


def test_the_likeliest_widths_have_no_likelier_neighbours():
    for seed in range(6):
        *_, sheet, _, _ = board_of_all(seed)
        evidence = Evidence(sheet, SIGMA)
        best = np.array(likeliest(evidence))
        near = [tuple(best + s) for s in np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])]
        near = [s for s in near if all(0 <= n < m for n, m in zip(s, (6, 4, 9), strict=True))]
        assert max(evidence.log_likelihoods(near)) <= evidence.log_likelihoods([tuple(best)])[0]
