"""The fit of windows that follow the model exactly, as double precision and the error function itself draw it."""

import numpy as np
import pytest
from scipy.special import erf
from window_pixels import windows

from rcdn.precision.fit import fit_round, levels
from rcdn.precision.lattice import Lattice
from rcdn.precision.model import BLUR, CONTRAST, COUNT, CURVE, MEAN
from rcdn.precision.prior import Prior
from rcdn.precision.window import frames

SIZE, PITCH = 128, 24.0
START = np.zeros(COUNT)
START[[MEAN, CONTRAST]] = 120, 80
TRUE = np.add(START, [0.02, -0.015, 0.01, 0.02, 0.01, -0.008, 0.3, 0.2, 0.08, 5, -6, 6, -4, 8, 5])
"""everything at once, far from the start"""


def maps(turn=0.4):
    """A corner a little off the middle of the picture, with squares of PITCH px, and no perspective."""
    step = PITCH * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    terms = np.zeros((1, 6, 2))
    terms[0, 1:3] = np.linalg.inv(step).T
    return Lattice(np.eye(3), np.full((1, 2), SIZE / 2 + 0.3), terms)


def wave(own, there, push, scale, board):
    """A square wave with edges where `own` + `push` = 0 and, on a board, at the next corners."""
    out = erf((own + push) * scale)
    for side in (1, -1) if board else ():
        out = out - erf((there - side - push) * scale)
    return out


def drawn(state, w, board=True):
    """Grey levels (1, P) of the model."""
    p, u, v = state, w.u.astype(float), w.v.astype(float)
    scale_u, scale_v = np.exp(-p[6]) / (np.sqrt(2) * w.gu), np.exp(-p[7]) / (np.sqrt(2) * w.gv)
    own_u, own_v = u - p[0] - p[2] * v - p[4] * v**2, v - p[1] - p[3] * u - p[5] * u**2
    bleed = p[8] * np.sign(p[10])
    one = wave(own_u, u, bleed * erf(own_v * scale_v) * w.gu, scale_u, board)
    two = wave(own_v, v, bleed * erf(own_u * scale_u) * w.gv, scale_v, board)
    return np.clip(p[9] + p[11] * u + p[12] * v + (p[10] + p[13] * u + p[14] * v) * one * two, 0, 255)


def picture(state, board=True, turn=0.4):
    """(picture, maps, frame) of one corner with that state."""
    at, blank = maps(turn), np.zeros((SIZE, SIZE), np.float32)
    frame = frames(at, at.origin, np.zeros((1, 2), bool), 3.0)
    w = windows(blank, at, frame)
    x, y = (w.spot[:, 0] + w.centre.T).astype(int)
    blank[y, x] = drawn(state, w, board)[0]
    return blank, at, frame


def fitted(grey, at, frame, start=START, steps=12, sd=np.inf, **settings):
    free = Prior(start[None].copy(), np.full((1, COUNT), sd))
    return fit_round(grey, frame, at, start[None], free, settings.pop("noise", 1.0), steps, **settings)


@pytest.mark.parametrize("board", [True, False])
@pytest.mark.parametrize("contrast", [1, -1])
@pytest.mark.parametrize("turn", [0.4, 0.0, np.pi / 2, 2.5])
def test_the_fit_finds_every_parameter(board, contrast, turn):
    flip = np.ones(COUNT)
    flip[[CONTRAST, 13, 14]] = contrast
    done = fitted(*picture(TRUE * flip, board, turn), START * flip, robust=False, board=board)
    error = np.abs(done.state[0] - TRUE * flip)
    assert error[:6].max() < 2e-4
    assert error[6:8].max() < 2e-3
    assert error[8] < 2e-3
    assert error[9:].max() < 0.05
    assert done.kept[0] == pytest.approx(1)


def test_other_blurs_show_the_edges_of_the_next_corners():
    state = TRUE.copy()
    state[BLUR] = np.log(6.0)
    start = START.copy()
    start[BLUR] = np.log(5.0)
    done = fitted(*picture(state), start, robust=False)
    assert np.abs(done.state[0] - state)[:2].max() < 5e-4
    blind = fitted(*picture(state), start, robust=False, board=False)
    assert np.abs(blind.state[0] - state)[:8].max() > 0.02


def test_the_inverse_normal_matrix_is_that_of_the_slopes():
    """In even light, and without bleed: what both do to the slopes of the other parameters is left out."""
    state = np.where(np.isin(np.arange(COUNT), [8, 11, 12, 13, 14]), 0, TRUE)
    grey, at, frame = picture(state)
    done = fitted(grey, at, frame, state, steps=0, robust=False)
    w = windows(grey, at, frame)
    step = np.diag(np.where(np.arange(COUNT) < 9, 1e-5, 1e-3))
    slopes = np.stack([(drawn(state + s, w) - drawn(state - s, w))[w.mask] / (2 * s.max()) for s in step])
    unit = np.linalg.inv(slopes @ slopes.T)
    np.testing.assert_allclose(done.own[0], np.diag(unit), rtol=2e-3)
    np.testing.assert_allclose(done.unit[0], unit[:2, :2], rtol=2e-3, atol=2e-3 * unit[0, 0])


def test_a_prior_holds_what_it_knows():
    grey, at, frame = picture(TRUE)
    assert np.abs(fitted(grey, at, frame, sd=1e-6, steps=4).state[0] - START).max() < 1e-4


def test_pixels_that_disagree_lose_their_weight():
    grey, at, frame = picture(TRUE)
    grey[:, : SIZE // 2 - 5] = 250
    done = fitted(grey, at, frame, TRUE, robust=True, steps=3)
    assert np.abs(done.state[0] - TRUE)[:2].max() < 1e-3
    assert 0.3 < done.kept[0] < 0.8
    assert done.variance[0] < 1
    gullible = fitted(grey, at, frame, TRUE, robust=False, steps=3)
    assert np.abs(gullible.state[0] - TRUE)[:2].max() > 0.01
    assert gullible.kept[0] == 1


def test_cut_levels_do_no_harm():
    state = TRUE.copy()
    state[[MEAN, CONTRAST]] = 160, 140
    done = fitted(*picture(state), state + 0.01 * (START - TRUE), robust=False)
    assert np.abs(done.state[0] - state)[:2].max() < 1e-3


def test_variance_and_scores_of_white_noise():
    """Blocks of white noise pull as far as its variance says; noise that goes together pulls further."""
    grey, at, frame = picture(TRUE)
    rng, found = np.random.default_rng(0), []
    for _ in range(60):
        noise = rng.normal(0, 3, grey.shape)
        wide = np.repeat(np.repeat(rng.normal(0, 3, (SIZE // 4, SIZE // 4)), 4, axis=0), 4, axis=1)
        for shade in (noise, wide):
            done = fitted(
                (grey + shade).astype(np.float32), at, frame, TRUE, noise=9.0, steps=3, robust=False, share=1 / 3
            )
            found.append((done.variance[0], done.scores[0, 0] / (9 * done.scores[0, 1])))
    variance, factor = np.array(found).reshape(60, 2, 2).mean(axis=0).T
    assert variance[0] == pytest.approx(9, rel=0.05)
    assert factor[0] == pytest.approx(1, abs=0.15)
    assert factor[1] > 3


def test_windows_without_a_pixel_give_no_answer_and_no_trouble():
    grey, at, frame = picture(TRUE)
    frame[:, 8] += 1000
    done = fitted(grey, at, frame, steps=2, sd=1.0, share=1 / 3)
    np.testing.assert_allclose(done.state[0], START)
    assert done.kept[0] == 0
    assert np.isfinite(done.own).all()


def test_straight_edges_of_the_right_blur_fit_best():
    state = START.copy()
    state[BLUR], state[CURVE] = np.log(1.2), 0
    found = levels(*(picture(state)[k] for k in (0, 2, 1)), np.array([0.5, 0.8, 1.2, 2.0, 3.2]))
    assert np.argmin(found[:, 0, 0]) == 2
    assert found[2, 0, 0] < 0.01
    np.testing.assert_allclose(found[2, 0, 1:], [120, 80], atol=0.05)


def test_a_round_that_tells_nothing_finds_the_same():
    maps_, w, state = maps(), np.array([[SIZE / 2 + 0.3, SIZE / 2 + 0.3]]), START[None].copy()
    frame = frames(maps_, w, np.zeros((1, 2), bool), 1.0)
    grey = (np.random.default_rng(2).normal(120, 20, (SIZE, SIZE))).clip(0, 255).astype(np.float32)
    prior = Prior(state.copy(), np.full_like(state, 0.3))
    for robust in (False, True):
        one, other = (
            fit_round(grey, frame, maps_, state, prior, 400.0, 2, robust=robust, tell=tell) for tell in (False, True)
        )
        assert np.array_equal(one.state, other.state)
        assert np.array_equal(one.variance, other.variance)
        assert np.array_equal(one.kept, other.kept)
        assert (one.own == 0).all()
        assert (other.own > 0).all()
