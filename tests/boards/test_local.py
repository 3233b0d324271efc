"""Predictions from neighbours, without a picture."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards.local import Grid, windows
from rcdn.geometry.median import median

SPOTS = [(u, v) for v in range(5) for u in range(6)]


def grid_of(image_of, spots=SPOTS):
    """Grid of the corners at `spots`, positions by `image_of` (N, 2) → (N, 2)."""
    return Grid({s: k for k, s in enumerate(spots)}, image_of(np.array(spots, float)))


def predicted(grid, spot):
    """The prediction of one spot, which its neighbours support."""
    guess = grid.predictions([spot])
    assert guess.support[0] > 0
    return guess


def affine(uv):
    return uv @ [[30.0, 4.0], [-6.0, 27.0]] + [100, 50]


def perspective(uv):
    return affine(uv) / (1 + uv @ [[0.04], [-0.02]])


def parabola(uv):
    u, v = uv.T
    return affine(uv) + np.stack([0.8 * u * u - 0.5 * u * v, 0.4 * v * v + 0.3 * u * v], axis=1)


@pytest.mark.parametrize("spot", SPOTS)
def test_exact_where_the_map_is_quadratic(spot):
    guess = predicted(grid_of(parabola), spot)
    np.testing.assert_allclose(guess.xy, parabola(np.array([spot], float)), atol=1e-6)


@pytest.mark.parametrize("spot", [(6, 2), (2, -1), (-1, 4), (6, 5)])
def test_beyond_the_rim_two_lines_extrapolate(spot):
    """Exact for an affine map; a curved one is missed by at most its second difference per square."""
    true = np.array([spot], float)
    np.testing.assert_allclose(predicted(grid_of(affine), spot).xy, affine(true), atol=1e-6)
    assert np.abs(predicted(grid_of(parabola), spot).xy - parabola(true)).max() < 3


def test_steps_and_pitch():
    guess = predicted(grid_of(affine), (2, 2))
    np.testing.assert_allclose([guess.du[0], guess.dv[0]], [[30, 4], [-6, 27]], atol=1e-9)
    assert guess.pitch[0] == pytest.approx(np.hypot(6, 27))
    assert guess.support[0] == 24


def test_perspective_is_near_enough():
    """Inside within 2 % of a square, one beyond the rim within 10 %."""
    grid = grid_of(perspective)
    for spot in [*SPOTS, *((u, v) for u in (-1, 6) for v in range(5)), *((u, v) for u in range(6) for v in (-1, 5))]:
        inside = 0 < spot[0] < 5 and 0 < spot[1] < 4
        guess = predicted(grid, spot)
        gap = np.linalg.norm(guess.xy - perspective(np.array([spot], float)))
        assert gap < (0.02 if inside else 0.1) * guess.pitch[0]


@pytest.mark.parametrize("spot", SPOTS)
def test_a_corner_has_no_say_in_its_own_prediction(spot):
    grid, other = grid_of(perspective), grid_of(perspective)
    other.xy[other.at[spot]] += 1000
    np.testing.assert_array_equal(predicted(grid, spot).xy, predicted(other, spot).xy)


def test_only_near_corners_have_a_say():
    spots = [(u, v) for v in range(9) for u in range(9)]
    grid, other = grid_of(perspective, spots), grid_of(perspective, spots)
    far = [other.at[s] for s in spots if max(abs(s[0] - 1), abs(s[1] - 1)) > 2]
    other.xy[far] += 1000
    np.testing.assert_array_equal(predicted(grid, (1, 1)).xy, predicted(other, (1, 1)).xy)


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
    grid = grid_of(affine, spots) if spots else Grid({}, np.zeros((0, 2)))
    assert grid.predictions([spot]).support.tolist() == [0]


@pytest.mark.parametrize("image_of", [affine, perspective])
def test_three_corners_of_a_square_predict_the_fourth(image_of):
    guess = predicted(grid_of(image_of, [(0, 0), (1, 0), (0, 1)]), (1, 1))
    gap = np.linalg.norm(guess.xy - image_of(np.array([[1.0, 1]])))
    assert gap < 0.1 * guess.pitch[0]
    assert guess.support[0] == 3


def test_few_near_neighbours_reach_one_ring_further():
    spots = [(0, 3), (1, 3), (2, 3), (0, 2), (1, 2)]
    assert predicted(grid_of(affine, spots), (0, 0)).support[0] == 5
    assert predicted(grid_of(affine, SPOTS), (0, 0)).support[0] == 8


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
        one = grid.predictions([spot])
        assert many.support[k] == one.support[0]
        np.testing.assert_array_equal(many.maps[k], one.maps[0])
        np.testing.assert_array_equal(many.pitch[k], one.pitch[0])


def test_a_grid_copies_its_labels():
    labels = {(0, 0): 0}
    grid = Grid(labels, np.zeros((1, 2)))
    del grid.at[0, 0]
    assert labels == {(0, 0): 0}


def by_singular_values(near):
    """(3, K): positions of neighbours at offsets `near` → position and steps of the spot, as `Grid.predictions` says;
    None if there are none."""
    u, v = np.array(near, float).reshape(-1, 2).T
    columns, rows = len(np.unique(u)), len(np.unique(v))
    if len(u) < 3 or min(columns, rows) < 2:
        return None
    terms = [np.ones(len(u)), u, v, u * v, u * u, v * v]
    used = [True, True, True, len(u) >= 4, len(u) >= 6 and columns >= 3, len(u) >= 7 and rows >= 3]
    weight = 1 / (1 + u * u + v * v)
    basis = np.stack([t for t, has in zip(terms, used, strict=True) if has], axis=1) * weight[:, None]
    if np.linalg.matrix_rank(basis) < 3:
        return None
    return (np.linalg.pinv(basis, rcond=1e-6) * weight)[:3]


OFFSETS = [(d, e) for d in range(-3, 4) for e in range(-3, 4) if d or e]


@settings(max_examples=400, deadline=None, derandomize=True)
@given(st.data(), st.integers(0, 10_000))
def test_predictions_are_least_squares_whatever_is_there(data, seed):
    """Few neighbours leave many maps, of which the smallest counts; in lines and crosses some terms are all alike."""
    most = data.draw(st.sampled_from([3, 4, 5, 6, 8, 12, 48]))
    spots = data.draw(st.lists(st.sampled_from(OFFSETS), unique=True, max_size=most))
    close = [s for s in spots if max(map(abs, s)) <= 2]
    near = close if len(close) >= 6 else spots
    solver = by_singular_values(near)
    rng = np.random.default_rng(seed)
    where = rng.uniform(0, 2000, 2) + np.array(spots, float).reshape(-1, 2) @ rng.normal(0, 20, (2, 2))
    where += rng.normal(0, 1, where.shape)
    shift = rng.integers(-9, 9, 2)
    grid = Grid({(s[0] + int(shift[0]), s[1] + int(shift[1])): k for k, s in enumerate(spots)}, where)
    guess = grid.predictions([(int(shift[0]), int(shift[1]))])
    if solver is None:
        assert guess.support[0] == 0
        assert np.isnan(guess.maps).all()
        assert np.isnan(guess.pitch).all()
        return
    assert guess.support[0] == len(near)
    expected = solver @ where[[spots.index(s) for s in near]]
    np.testing.assert_allclose(guess.maps[0], expected.ravel(), rtol=0, atol=1e-8)
    assert guess.pitch[0] == pytest.approx(np.linalg.norm(expected[1:], axis=1).min())


@pytest.mark.parametrize("pitch", [30.0, 1.9])
def test_open_spots_lie_beside_the_corners(pitch):
    """In order, each once, with the predictions that they would have if asked for; none of squares under 2 px."""
    spots = [s for s in SPOTS if s not in ((2, 2), (5, 4))]
    grid = grid_of(lambda uv: uv @ [[pitch, 0.0], [0.0, 30.0]], spots)
    beside, guess = grid.beside()
    ways = ((1, 0), (0, 1), (-1, 0), (0, -1))
    expected = sorted({(u + d, v + e) for u, v in spots for d, e in ways} - set(spots)) if pitch > 2 else []
    assert list(map(tuple, beside.tolist())) == expected
    for mine, predicted in zip(guess, grid.predictions(expected), strict=True):
        np.testing.assert_array_equal(mine, predicted)


def test_nothing_is_beside_an_empty_grid():
    beside, guess = Grid({}, np.zeros((0, 2))).beside()
    assert beside.shape == (0, 2)
    assert guess.maps.shape == (0, 6)


def test_labels_may_lie_anywhere():
    far = 2**40
    grid = grid_of(lambda uv: uv - [far, -far], [(u + far, v - far) for u, v in SPOTS])
    np.testing.assert_allclose(predicted(grid, (far + 2, 2 - far)).xy, [[2, 2]], atol=1e-9)
    assert (windows(grid.labels, [(0, 0), (-far, far)], 1) == -1).all()


def test_labels_far_apart_are_refused():
    grid = grid_of(affine, [(0, 0), (2**40, 0)])
    with pytest.raises(MemoryError):
        grid.predictions([(0, 1)])


@given(st.lists(st.floats(-1e3, 1e3), min_size=1))
def test_median(values):
    assert median(np.array(values)) == pytest.approx(np.median(values))
