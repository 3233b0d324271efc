"""Local maps of a board against what they stand for: known sheets, and slow and plain versions of
what the kernels reckon."""

import numpy as np
import pytest

from rcdn.geometry import apply_homography
from rcdn.precision.lattice import FAR, STIFF, lattice, misfit, neighbours

H = np.array([[28.0, 4.0, 120.0], [-3.0, 25.0, 90.0], [0.012, 0.006, 1.0]])


def labels(cols=7, rows=5, drop=()):
    ij = np.stack(np.meshgrid(3 + np.arange(cols), np.arange(rows) - 2), axis=-1).reshape(-1, 2)
    return np.delete(np.random.default_rng(0).permutation(ij), drop, axis=0)


def bent(ij, seed=1, size=0.3):
    return apply_homography(H, ij) + np.random.default_rng(seed).normal(0, size, ij.shape)


def test_neighbours_are_those_with_the_labels_next_to_it():
    ij = labels(drop=[3, 8, 20])
    index = {(i, j): k for k, (i, j) in enumerate(ij.tolist())}
    for reach in (1, 2):
        steps = [(a, b) for a in range(-reach, reach + 1) for b in range(-reach, reach + 1)]
        expected = [[index.get((i + a, j + b), -1) for a, b in steps] for i, j in ij.tolist()]
        assert np.array_equal(neighbours(ij, reach), expected)


def test_on_a_flat_board_every_map_is_the_board():
    ij = labels()
    xy = apply_homography(H, ij)
    maps, every = lattice(ij, xy), np.arange(len(ij))
    there = ij[:, None] + np.random.default_rng(2).uniform(-1, 1, (len(ij), 4, 2))
    np.testing.assert_allclose(maps(every, apply_homography(H, there)), there - ij[:, None], atol=1e-6)
    assert misfit(maps, ij, xy, 0.0) < 1e-6


@pytest.mark.parametrize("own", [0.0, 1.0])
def test_quadratics_are_the_least_squares_of_the_neighbours(own):
    ij = labels(drop=[1, 4, 17])
    maps = lattice(ij, bent(ij), own=own)
    for k in range(len(ij)):
        step = ij - ij[k]
        near = np.abs(step).max(axis=1) <= 2
        s, t = (maps.origin[near] - maps.origin[k]).T
        basis = np.stack([s**0, s, t, s * s, s * t, t * t], axis=1)
        far = np.abs(step[near]).max(axis=1)
        weight = np.where(far == 0, own, np.where(far > 1, FAR, 1.0))
        rows = np.concatenate([np.sqrt(weight)[:, None] * basis, np.diag(np.sqrt(STIFF))])
        right = np.concatenate([np.sqrt(weight)[:, None] * step[near], np.zeros((6, 2))])
        np.testing.assert_allclose(maps.terms[k], np.linalg.lstsq(rows, right, rcond=None)[0], atol=1e-7)


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("own", [0.0, 1.0])
def test_a_corner_whose_neighbours_lie_on_one_line_gets_their_similarity(size, own):
    """A tail of corners on the end of a board."""
    body, tail = labels(), np.stack([10 + np.arange(4 + size), np.full(4 + size, 2)], axis=1)
    ij = np.concatenate([body, tail])
    maps = lattice(ij, bent(ij, size=0.1), own=own)
    for k in range(len(body) + 4, len(ij)):
        step = ij - ij[k]
        distance = np.abs(step).max(axis=1)
        weight = np.where(distance > 2, 0, np.where(distance > 1, FAR, np.where(distance == 0, own, 1.0)))
        near = weight > 0
        assert (step[near][:, 1] == 0).all()
        s, t = (maps.origin[near] - maps.origin[k]).T
        one, zero = s**0, 0 * s
        basis = np.concatenate([np.stack([one, zero, s, -t], axis=1), np.stack([zero, one, t, s], axis=1)])
        root = np.sqrt(np.tile(weight[near], 2))
        found = np.linalg.lstsq(root[:, None] * basis, root * step[near].T.ravel(), rcond=None)[0]
        u, v, a, b = found
        expected = np.array([[u, v], [a, b], [-b, a], [0, 0], [0, 0], [0, 0]])
        np.testing.assert_allclose(maps.terms[k], expected, atol=1e-9)
        assert abs(np.linalg.det(maps.terms[k][1:3]) - 1) < 0.2


def test_a_corner_without_neighbours_keeps_the_homography():
    ij = np.concatenate([labels(), [[14, 0]]])
    for own in (0.0, 1.0):
        maps = lattice(ij, bent(ij, size=0.0), own=own)
        np.testing.assert_allclose(maps.terms[-1], [[0, 0], [1, 0], [0, 1], [0, 0], [0, 0], [0, 0]], atol=1e-9)


def test_pixels_undo_coordinates_and_slopes_are_their_derivatives():
    ij = labels()
    maps, which = lattice(ij, bent(ij)), np.random.default_rng(3).permutation(len(ij))
    xy = bent(ij)[which]
    uv = np.random.default_rng(4).uniform(-0.3, 0.3, xy.shape)
    there = maps.pixels(which, uv, xy, repeats=12)
    np.testing.assert_allclose(maps(which, there), uv, atol=1e-12)
    slopes, step = maps.with_jacobian(which, there)[1], 1e-4
    for axis in (0, 1):
        move = step * np.eye(2)[axis]
        by = (maps(which, there + move) - maps(which, there - move)) / (2 * step)
        np.testing.assert_allclose(slopes[..., axis], by, atol=1e-8)


def test_misfit_is_what_noise_leaves():
    ij = labels(20, 15)
    crooked = [misfit(lattice(ij, xy), ij, xy, 0.0) for xy in (bent(ij, size=size) for size in (0.1, 0.4))]
    assert crooked[1] == pytest.approx(4 * crooked[0], rel=0.02)
    xy = bent(ij, size=0.1)
    assert misfit(lattice(ij, xy), ij, xy, 2 * crooked[0] ** 2) == 0
    assert misfit(lattice(ij[:4], xy[:4]), ij[:4], xy[:4], 0.0) == 0  # nobody has all neighbours


def test_a_homography_with_its_horizon_on_the_board_gives_way_to_an_affine_map():
    ij = labels()
    far = np.array([[1.0, 0, 0], [0, 1, 0], [0.4, 0.3, -3.0]])
    maps = lattice(ij, apply_homography(far, ij + 0.01))
    assert np.array_equal(maps.flat[2], [0, 0, 1])


def test_positions_that_are_not_finite_are_refused():
    ij = labels()
    xy = bent(ij)
    xy[3, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        lattice(ij, xy)
