"""Predictions from neighbours, without a picture."""

import numpy as np
import pytest

from rcdn.boards.local import Grid

SPOTS = [(u, v) for v in range(5) for u in range(6)]


def grid_of(image_of, spots=SPOTS):
    """Grid of the corners at `spots`, positions by `image_of` (N, 2) → (N, 2)."""
    return Grid({s: k for k, s in enumerate(spots)}, image_of(np.array(spots, float)))


def affine(uv):
    return uv @ [[30.0, 4.0], [-6.0, 27.0]] + [100, 50]


def perspective(uv):
    return affine(uv) / (1 + uv @ [[0.04], [-0.02]])


def parabola(uv):
    u, v = uv.T
    return affine(uv) + np.stack([0.8 * u * u - 0.5 * u * v, 0.4 * v * v + 0.3 * u * v], axis=1)


@pytest.mark.parametrize("spot", SPOTS)
def test_exact_where_the_map_is_quadratic(spot):
    guess = grid_of(parabola).predict(spot)
    np.testing.assert_allclose(guess.xy, parabola(np.array([spot], float))[0], atol=1e-6)


@pytest.mark.parametrize("spot", [(6, 2), (2, -1), (-1, 4), (6, 5)])
def test_beyond_the_rim_two_lines_extrapolate(spot):
    """Exact for an affine map; a curved one is missed by at most its second difference per square."""
    true = np.array([spot], float)
    np.testing.assert_allclose(grid_of(affine).predict(spot).xy, affine(true)[0], atol=1e-6)
    assert np.abs(grid_of(parabola).predict(spot).xy - parabola(true)[0]).max() < 3


def test_steps_and_pitch():
    guess = grid_of(affine).predict((2, 2))
    np.testing.assert_allclose([guess.du, guess.dv], [[30, 4], [-6, 27]], atol=1e-9)
    assert guess.pitch == pytest.approx(np.hypot(6, 27))
    assert guess.count == 24


def test_perspective_is_near_enough():
    """Inside within 2 % of a square, one beyond the rim within 10 %."""
    grid = grid_of(perspective)
    for spot in [*SPOTS, *((u, v) for u in (-1, 6) for v in range(5)), *((u, v) for u in range(6) for v in (-1, 5))]:
        inside = 0 < spot[0] < 5 and 0 < spot[1] < 4
        guess = grid.predict(spot)
        gap = np.linalg.norm(guess.xy - perspective(np.array([spot], float))[0])
        assert gap < (0.02 if inside else 0.1) * guess.pitch


@pytest.mark.parametrize("spot", SPOTS)
def test_a_corner_has_no_say_in_its_own_prediction(spot):
    grid, other = grid_of(perspective), grid_of(perspective)
    other.xy[other.at[spot]] += 1000
    np.testing.assert_array_equal(grid.predict(spot).xy, other.predict(spot).xy)


def test_only_near_corners_have_a_say():
    spots = [(u, v) for v in range(9) for u in range(9)]
    grid, other = grid_of(perspective, spots), grid_of(perspective, spots)
    far = [other.at[s] for s in spots if max(abs(s[0] - 1), abs(s[1] - 1)) > 2]
    other.xy[far] += 1000
    np.testing.assert_array_equal(grid.predict((1, 1)).xy, other.predict((1, 1)).xy)


@pytest.mark.parametrize(
    ("spots", "spot"),
    [
        ([], (0, 0)),
        ([(1, 0), (0, 1)], (0, 0)),
        ([(u, 0) for u in range(6)], (6, 0)),  # one row doesn't say where the next is
        ([(u, 0) for u in range(6)], (2, 1)),
        ([(0, v) for v in range(6)], (0, 6)),
        ([(9, 9), (10, 9), (9, 10), (10, 10)], (0, 0)),
        ([(1, 1), (2, 2), (-1, -1)], (0, 0)),  # a diagonal
    ],
)
def test_no_prediction_without_support(spots, spot):
    assert grid_of(affine, spots).predict(spot) is None if spots else Grid({}, np.zeros((0, 2))).predict(spot) is None


@pytest.mark.parametrize("image_of", [affine, perspective])
def test_three_corners_of_a_square_predict_the_fourth(image_of):
    guess = grid_of(image_of, [(0, 0), (1, 0), (0, 1)]).predict((1, 1))
    gap = np.linalg.norm(guess.xy - image_of(np.array([[1.0, 1]]))[0])
    assert gap < 0.1 * guess.pitch
    assert guess.count == 3


def test_few_near_neighbours_reach_one_ring_further():
    spots = [(0, 3), (1, 3), (2, 3), (0, 2), (1, 2)]
    assert grid_of(affine, spots).predict((0, 0)).count == 5
    assert grid_of(affine, SPOTS).predict((0, 0)).count == 8


def test_the_corners_around_a_label():
    grid = grid_of(affine)
    near = grid.around([(0, 0), (2, 2)], 2)
    assert near[0].tolist() == [grid.at.get((u, v), -1) for v in range(-2, 3) for u in range(-2, 3)]
    assert (near[1] >= 0).all()
    assert (Grid({}, grid.xy).around([(4, 7)], 1) == -1).all()
    assert len(grid) == 30


def test_many_predictions_are_those_of_each():
    grid = grid_of(perspective)
    spots = [*SPOTS, (-1, 0), (40, 40), (6, 5)]
    many = grid.predictions(spots)
    for k, spot in enumerate(spots):
        one = grid.predict(spot)
        assert many.support[k] == (0 if one is None else one.count)
        if one is not None:
            np.testing.assert_allclose(many.xy[k], one.xy, rtol=0, atol=1e-9)
            assert many.pitch[k] == pytest.approx(one.pitch)


def test_a_grid_copies_its_labels():
    labels = {(0, 0): 0}
    grid = Grid(labels, np.zeros((1, 2)))
    del grid.at[0, 0]
    assert labels == {(0, 0): 0}
