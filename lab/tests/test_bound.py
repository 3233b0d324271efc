"""The Cramér–Rao bound of rendered corners against its closed form, and against what it must not depend on."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.synthetic import truth
from rcdn_lab.sweep.bound import QUANTISED, bounds, closed_form, mean_length
from rcdn_lab.sweep.pictures import scene
from rcdn_lab.sweep.settings import BASE


def mean_bound(seed=3, **changes):
    """The bound of each corner of the base's board with changes, px."""
    return bounds(scene(replace(BASE, **changes), [2, seed]))[0]


def test_the_figures_of_the_closed_form():
    """C = 170, σ_b = 0.76, L = 10: 0.027 px of mean error at noise 10, 0.054 at 20, 0.11 at 40."""
    for noise, error in ((10, 0.027), (20, 0.054), (40, 0.107)):
        assert closed_form(noise, 170, 10, 0.76) * np.sqrt(np.pi / 2) == pytest.approx(error, rel=0.02)


@pytest.mark.parametrize(
    "changes", [{}, {"noise": 20}, {"contrast": 60}, {"blur": 1.5}, {"blur": 1.5, "square": 15}], ids=lambda c: str(c)
)
def test_a_board_face_on_has_the_closed_form(changes):
    """An arm is half a square less ∫ 1 − erf²(t / √2σ) dt = 2σ / √π, for at the corner itself the four fields merge.

    The pixel's own width adds 1/12 to the square of the blur.
    """
    setting = replace(BASE, tilt=0.0, **changes)
    blur = np.sqrt(setting.blur**2 + 1 / 12)
    where = scene(setting, [2, 3])
    arm = setting.square / 2 - 2 * blur / np.sqrt(np.pi)
    known = closed_form(np.hypot(setting.noise, QUANTISED), setting.contrast, arm, blur)
    assert bounds(where)[0].mean() == pytest.approx(known * np.sqrt(np.pi / 2), rel=0.015)


def test_no_noise_leaves_rounding():
    assert mean_bound(noise=0) == pytest.approx(mean_bound(noise=2.9) / np.hypot(10, 1), rel=1e-6)


def test_tilt_widens_it():
    assert mean_bound(tilt=60).mean() > 1.2 * mean_bound(tilt=0).mean()


def test_a_cover_tells_nothing():
    where = scene(replace(BASE, cover="quadrant"), [2, 3])
    known, error = truth(where)[0], bounds(where)[0]
    plain = bounds(replace(where, covers=()))[0]
    hidden = ~known.visible & ~known.ignore
    deep = hidden & (error > 100 * plain)
    assert deep.sum() >= 6  # those at its rim still show a bit
    assert error[known.visible] == pytest.approx(plain[known.visible], rel=0.9)
    assert np.median(error[known.visible] / plain[known.visible]) == pytest.approx(1, abs=1e-3)


def test_every_board_has_its_own():
    assert [len(b) for b in bounds(scene(replace(BASE, boards=3), [2, 1]))] == [54] * 3
    assert bounds(scene(replace(BASE, boards=0), [2, 1])) == []


def test_mean_length_is_that_of_normal_errors():
    rng = np.random.default_rng(0)
    covariance = np.array([[[1.0, 0], [0, 1]], [[4.0, 1], [1, 0.5]], [[1.0, 0], [0, 1e-9]], [[np.inf, 0], [0, 1]]])
    known = mean_length(covariance)
    assert known[0] == pytest.approx(np.sqrt(np.pi / 2))
    assert known[2] == pytest.approx(np.sqrt(2 / np.pi), rel=1e-4)
    drawn = np.linalg.norm(rng.multivariate_normal([0, 0], covariance[1], 200_000), axis=1).mean()
    assert known[1] == pytest.approx(drawn, rel=0.01)
    assert np.isinf(known[3])
