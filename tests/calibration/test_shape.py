"""The board's own shape: found beside the camera where it is there, nothing where it isn't, and no motion in it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rcdn.calibration import calibrate, choose, projection_uncertainty, robust
from rcdn.calibration.bundle import State
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.shape import (
    FALLING,
    FUNCTIONS,
    Spread,
    all_labels,
    board_shape,
    likeliest,
    shape_basis,
    with_spread,
)
from rcdn.calibration.solver import solve
from rcdn.errors import RcdnError
from rcdn.types import BoardShape
from rcdn_lab.camera_scenes import CAMERAS, SPACING, detected, random_boards, random_pose, see
from rcdn_lab.real_boards import smooth_error, uneven_board

BROWN = CAMERAS["brown"]
SIZE = (9, 6)
UNEVEN = uneven_board(np.random.default_rng(2), stretch=0.01, print_error=0.0001, bend=0.001)


def z_of(found):
    return (found.camera.parameters - BROWN.parameters) / found.std


@cache
def both(kind, seed=5):
    """(with its shape, as if perfect): the same 20 views, parts among them."""
    offsets = UNEVEN if kind == "uneven" else None
    boards, _ = random_boards(BROWN, seed, 20, offsets=offsets)
    return calibrate(boards, SPACING, model="brown"), calibrate(boards, SPACING, model="brown", flat=True)


@cache
def cut(seed):
    """Errors of cameras, px RMS over the picture, from 16 views of an uneven board, most of them cut by the border:
    (each part at its place on the board, parts anywhere)."""
    rng, boards = np.random.default_rng(seed), []
    while len(boards) < 16:
        ij, xy = see(BROWN, random_pose(rng, 0.7, 0.7, (0.25, 0.4)), offsets=UNEVEN)
        if len(ij) >= 24 and (len(ij) < 54 or len(boards) % 4 == 0):
            boards.append(detected(ij, xy + rng.normal(0, 0.1, xy.shape), (640, 480), np.full(len(xy), 0.1)))
    unknown = [replace(b, origin_dark=None, orientation="ambiguous_180") for b in boards]
    found = [calibrate(some, SPACING, model="brown", size=SIZE) for some in (boards, unknown)]
    assert [sum(v.settled for v in c.views) >= 14 for c in found] == [True, False]
    return tuple(camera_difference(c.camera, BROWN).rms for c in found)


def without_motion(offsets):
    """Offsets (N, 3) less the shift, turn, size and tilts in their mean slopes, to first order."""
    centred = all_labels(SIZE) - all_labels(SIZE).mean(axis=0)
    slopes = np.linalg.lstsq(centred, offsets - offsets.mean(axis=0), rcond=None)[0]
    size, turn = (slopes[0, 0] + slopes[1, 1]) / 2, (slopes[0, 1] - slopes[1, 0]) / 2
    return offsets - offsets.mean(axis=0) - centred @ [[size, turn, slopes[0, 2]], [-turn, size, slopes[1, 2]]]


# ---- calibrations


def test_parts_that_the_border_cut_have_the_shape_of_their_place():
    errors = np.array([cut(seed) for seed in range(3)])
    assert np.median(errors[:, 0]) < 0.5 * np.median(errors[:, 1])
    assert (errors[:, 0] < errors[:, 1]).all()


def test_an_uneven_board_is_found_with_the_camera():
    shaped, _ = both("uneven")
    assert np.abs(z_of(shaped)).max() < 3
    error = shaped.shape.offsets.reshape(-1, 3) - without_motion(UNEVEN)
    truth = without_motion(UNEVEN)
    assert np.sqrt((error[:, :2] ** 2).mean()) < 5e-5 < 0.2 * np.sqrt((truth[:, :2] ** 2).mean())
    assert np.sqrt((error[:, 2] ** 2).mean()) < 1.5e-4 < 0.2 * np.sqrt((truth[:, 2] ** 2).mean())
    assert shaped.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.06)


def test_taken_as_perfect_it_spoils_the_camera():
    """The fit of the same corners without a shape is off by several of the deviations that the one with it states."""
    shaped, flat = both("uneven")
    off = np.abs(flat.camera.parameters - BROWN.parameters) / shaped.std
    assert off[:4].max() > 5
    assert flat.rms > 2 * shaped.rms
    assert (shaped.std[:4] < 0.5 * flat.std[:4]).all()
    assert shaped.held_out < 0.5 * flat.held_out


def test_a_perfect_board_has_no_shape_and_costs_nothing():
    shaped, flat = both("perfect")
    assert shaped.shape.print_error < 3e-5
    assert shaped.shape.bend < 5e-5
    gap = np.abs(shaped.camera.parameters - flat.camera.parameters) / flat.std
    assert gap.max() < 0.5
    assert shaped.std == pytest.approx(flat.std, rel=0.15)
    assert np.abs(z_of(shaped)).max() < 3


def test_the_shape_does_not_cast_doubt_on_projections():
    """Of a motion or another size no corner tells: they aren't part of the shape, nor of the uncertainty."""
    pixels = np.array([[320.0, 240], [100, 100], [560, 400]])
    perfect = both("perfect")[0]
    for distance in (np.inf, 1.0):
        at = projection_uncertainty(both("uneven")[0], pixels, distance)
        assert at == pytest.approx(projection_uncertainty(perfect, pixels, distance), rel=0.5)


def test_the_shape_has_no_motion():
    found = both("uneven")[0].shape.offsets.reshape(-1, 3)
    assert np.abs(found - without_motion(found)).max() < 1e-3 * np.abs(found).max()


@pytest.mark.parametrize("size", [(8, 6), (7, 7)])
def test_labels_of_an_ambiguous_board_may_be_turned(size):
    """Half of the views are labelled from the other end: whatever shape is found,
    the camera isn't worse than without one."""
    offsets = uneven_board(np.random.default_rng(1), 0.003, 0.0001, 0.0007, size)
    boards, _ = random_boards(BROWN, 6, 16, whole=True, size=size, offsets=offsets)
    turned = [replace(b, ij=np.array(size) - 1 - b.ij) if k % 2 else b for k, b in enumerate(boards)]
    shaped, flat = (calibrate(turned, SPACING, model="brown", flat=f) for f in (False, True))
    off = [np.abs(f.camera.parameters - BROWN.parameters)[:4] for f in (shaped, flat)]
    assert np.linalg.norm(off[0]) < 1.1 * np.linalg.norm(off[1])
    assert np.abs(z_of(shaped)).max() < 4
    assert shaped.held_out < 1.02 * flat.held_out


# ---- functions


@pytest.mark.parametrize("size", [(9, 6), (5, 5), (11, 4)])
def test_functions_are_orthogonal_to_each_other_and_to_a_constant(size):
    basis = shape_basis(all_labels(size), size)
    assert basis.shape == (size[0] * size[1], len(FUNCTIONS))
    assert basis.mean(axis=0) == pytest.approx(0, abs=1e-12)
    product = basis.T @ basis / len(basis)
    assert product - np.diag(np.diag(product)) == pytest.approx(np.zeros(product.shape), abs=1e-9)
    there = np.diag(product)[2:] > 1e-6
    assert np.diag(product)[2:][there] == pytest.approx(1)
    assert there.all() or min(size) < 5
    assert product[0, 0] + product[1, 1] == pytest.approx(2)


def test_the_first_degree_has_one_slope_in_both_directions():
    basis = shape_basis(all_labels(SIZE), SIZE)
    ij = all_labels(SIZE) - [4, 2.5]
    slopes = (basis[:, :2] / np.where(ij == 0, np.nan, ij))[2]
    assert basis[:, :2] == pytest.approx(ij * slopes[0])


def test_functions_are_smooth_beyond_and_between_the_corners():
    ij = all_labels(SIZE)
    between = shape_basis(ij[:5] + 0.5, SIZE)
    assert np.isfinite(between).all()
    assert np.array_equal(shape_basis(ij[[7, 3]], SIZE), shape_basis(ij, SIZE)[[7, 3]])


def test_small_boards_have_fewer_functions():
    basis = shape_basis(all_labels((3, 2)), (3, 2))
    assert np.isfinite(basis).all()
    assert np.linalg.matrix_rank(basis) == np.abs(basis).max(axis=0).astype(bool).sum() == 5


def test_coefficients_become_the_shape():
    coefficients = np.random.default_rng(0).normal(size=(len(FUNCTIONS), 3))
    shape = board_shape(coefficients, SIZE)
    ij = np.array([[0, 0], [8, 5], [3, 2]])
    assert shape.at(ij) == pytest.approx(shape_basis(ij, SIZE) @ coefficients)


# ---- the prior and its spreads


def test_the_prior_holds_motions_and_falls_with_the_degree():
    state = State.mono(BROWN, np.eye(4)[None], np.zeros((len(FUNCTIONS), 3)))
    prior = with_spread(state, Spread(1e-4, 3e-4)).beforehand
    cov = np.linalg.inv(prior.precision[9:, 9:]).reshape(len(FUNCTIONS), 3, len(FUNCTIONS), 3)
    var = np.einsum("fafa->fa", cov)
    assert np.sqrt(var[2:]) == pytest.approx(FALLING[2:] * [1e-4, 1e-4, 3e-4])
    assert np.sqrt(var[:2, 2]).max() < 1e-3 * 3e-4  # tilts
    stretch, flat = np.zeros((2, len(FUNCTIONS), 3)), cov.reshape(3 * len(FUNCTIONS), -1)
    stretch[0, 0, 0], stretch[0, 1, 1] = np.sqrt([0.5, 0.5]) * [1, -1]
    stretch[1, 0, 0], stretch[1, 1, 1] = np.sqrt([0.5, 0.5])
    spread, size = (np.sqrt(s.ravel() @ flat @ s.ravel()) for s in stretch)
    assert spread == pytest.approx(1e-4)
    assert size < 1e-3 * 1e-4


def test_spreads_of_drawn_shapes_come_back():
    """Without doubt of the coefficients, the likeliest spread is their scatter."""
    rng, spread, found = np.random.default_rng(3), Spread(2e-4, 7e-4), []
    nothing = np.zeros((3 * len(FUNCTIONS),) * 2)
    cov = prior_covariance(spread)
    for _ in range(100):
        drawn = rng.multivariate_normal(np.zeros(len(cov)), cov, method="eigh").reshape(-1, 3)
        found.append(likeliest(drawn, nothing, spread, SPACING))
    assert np.sqrt(np.mean([f.plane**2 for f in found])) == pytest.approx(spread.plane, rel=0.1)
    assert np.sqrt(np.mean([f.depth**2 for f in found])) == pytest.approx(spread.depth, rel=0.1)
    # and if the corners tell nothing, it stays
    again = likeliest(np.zeros((len(FUNCTIONS), 3)), cov, spread, SPACING)
    assert (again.plane, again.depth) == pytest.approx((spread.plane, spread.depth), rel=1e-3)


def prior_covariance(spread):
    """Of a shape's coefficients under `spread`."""
    state = State.mono(BROWN, np.eye(4)[None], np.zeros((len(FUNCTIONS), 3)))
    return np.linalg.inv(with_spread(state, spread).beforehand.precision[9:, 9:])


@pytest.mark.parametrize("true", [Spread(2e-4, 7e-4), Spread(1e-8, 1e-8)], ids=["bent", "flat"])
def test_spreads_are_those_of_estimates_made_again(true):
    """Of the same corners, estimated again under each new spread, they do not change any more; and they do not depend
    on those that the first estimate was made under."""
    rng = np.random.default_rng(5)
    information = np.diag(rng.uniform(0.5, 2, 3 * len(FUNCTIONS)) / 3e-6**2)
    drawn = rng.multivariate_normal(np.zeros(len(information)), prior_covariance(true), method="eigh")
    seen = drawn + rng.normal(0, 1 / np.sqrt(np.diag(information)))

    def under(spread):
        cov = np.linalg.inv(information + np.linalg.inv(prior_covariance(spread)))
        return (cov @ information @ seen).reshape(-1, 3), cov, spread, SPACING

    first, wide = (likeliest(*under(spread)) for spread in (Spread.first(SPACING), Spread(1e-3, 1e-3)))
    assert first.near(likeliest(*under(first)), 0.02)
    assert first.near(wide, 0.15)
    if true.plane > 1e-6:
        scatter = (drawn.reshape(-1, 3) / FALLING)[2:].std(axis=0)
        assert first.near(Spread(np.hypot(*scatter[:2]) / np.sqrt(2), scatter[2]), 0.2)
    else:
        assert first.plane < 1e-5
        assert first.depth < 1e-5


def test_a_small_board_that_is_printed_very_unevenly_is_no_flat_one():
    """The likelihood rises slowly at first: of nine corners no shape is plain under the spreads of ordinary prints."""
    size = (3, 3)
    drawn = np.random.default_rng(9).normal(size=(len(FUNCTIONS), 3)) * FALLING * [0.05, 0.05, 0.003] * SPACING
    drawn[:2] = 0
    offsets = shape_basis(all_labels(size), size) @ drawn
    boards, _ = random_boards(BROWN, 9, 10, noise=0.1, whole=True, offsets=offsets, size=size)
    done = calibrate(boards, SPACING, model="brown", size=size)
    assert done.shape.print_error == pytest.approx(np.sqrt((offsets[:, :2] ** 2).sum(axis=1).mean()), rel=0.4)
    assert abs(done.camera.K[0, 0] - BROWN.K[0, 0]) < 3 * done.std[0] < 0.1 * BROWN.K[0, 0]


def test_a_fit_of_a_flat_board_converges(monkeypatch):
    """The spreads of a shape that is not there fall slowly: they are not found by fitting again for each step."""
    fits = []
    monkeypatch.setattr(robust, "solve", lambda *given, **more: fits.append(1) or solve(*given, **more))
    boards = random_boards(BROWN, 3, views=12)[0]
    done = calibrate(boards, SPACING, model="brown")
    assert done.shape is not None
    assert len(fits) < robust.ROUNDS  # all rounds of the fit and of the initial fit before it


# ---- BoardShape


def test_bend_and_print_error_are_lengths():
    offsets = np.zeros((6, 9, 3))
    offsets[0, 0, 2], offsets[5, 8, 2], offsets[:, :, :2] = -0.001, 0.002, [0.0003, 0.0004]
    shape = BoardShape(offsets)
    assert shape.size == (9, 6)
    assert shape.bend == pytest.approx(0.003)
    assert shape.print_error == pytest.approx(0.0005)
    assert shape.at(np.array([[8, 5]])) == pytest.approx(offsets[None, 5, 8])
    with pytest.raises(RcdnError, match="9×6"):
        shape.at(np.array([[9, 0]]))
    with pytest.raises(RcdnError, match=r"\(rows, columns, 3\)"):
        BoardShape(np.zeros((54, 3)))


def test_simulated_unevenness_is_as_large_as_said():
    error = smooth_error(np.random.default_rng(0), 0.002)
    assert np.sqrt((error**2).mean()) == pytest.approx(0.002)
    assert error.mean() == pytest.approx(0, abs=1e-12)
    x = all_labels(SIZE)[:, 0] - 4.0
    board = uneven_board(np.random.default_rng(0), 0.01, 0.0, 0.0)
    assert board[:, 0] == pytest.approx(0.005 * x * SPACING)
    assert board[:, 2] == pytest.approx(0)


@pytest.mark.parametrize(("excess", "flat_wins"), [(1.08, False), (1.12, True)])
def test_only_a_clearly_better_prediction_by_a_perfect_board_refutes_a_shape(monkeypatch, excess, flat_wins):
    """Errors in pictures held out that are 8 % and 12 % larger with the shape."""
    boards, _ = random_boards(CAMERAS["brown"], 1, 8, whole=True)
    found = []
    monkeypatch.setattr(choose, "flat_predicts_better", lambda *some: found.append(some))
    calibrate(boards, SPACING, model="brown")
    monkeypatch.undo()
    flat, held, *rest = found[0]
    error = choose.held_out_rms(flat, *rest)
    assert held == pytest.approx(error, rel=0.05)  # of a perfect board
    assert choose.flat_predicts_better(flat, excess * error, *rest) == flat_wins
