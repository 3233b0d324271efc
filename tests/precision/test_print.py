"""What is printed beside a corner, as double precision and the error function itself draw it,
is part of what is fitted."""

import numpy as np
import pytest
from scipy.special import erf
from test_fit import SIZE, START, TRUE, drawn, fitted, maps
from window_pixels import windows

from rcdn.precision.fit import levels
from rcdn.precision.model import BLUR, CONTRAST, CURVE
from rcdn.precision.surroundings import EDGES, shape
from rcdn.precision.surroundings import drawn as for_kernels
from rcdn.precision.window import frames

U, V = np.array([-0.4, -0.3, -0.1, 0.05, 0.3]), np.array([-0.35, -0.2, 0.1, 0.4])
VALUES = np.array([[-2, -2, 0], [-2, 0, -2], [0, 0, -2], [-2, -2, -2]])
AT = np.array([[0.55, 0.5], [-0.5, -0.5]])


def printed(bright=True):
    shapes = [shape(U, V, VALUES), shape(V, U, -VALUES.T)]
    return for_kernels(
        shapes, np.array([[0, 1, -1, -1]]), np.append(AT, np.zeros((2, 2)), axis=0)[None], np.array([bright])
    )


def shade(state, w):
    """What is printed, in contrasts, (1, P)."""
    p, u, v = state, w.u.astype(float), w.v.astype(float)
    own = u - p[0] - p[2] * v - p[4] * v**2, v - p[1] - p[3] * u - p[5] * u**2
    scale = np.exp(-p[6]) / (np.sqrt(2) * w.gu), np.exp(-p[7]) / (np.sqrt(2) * w.gv)
    box = lambda k, low, high: (erf((own[k] - low) * scale[k]) - erf((own[k] - high) * scale[k])) / 2  # noqa: E731
    out = np.zeros(u.shape)
    for (x, y), (along, down, values) in zip(AT, ((U, V, VALUES), (V, U, -VALUES.T)), strict=True):
        for a, b in np.argwhere(values):
            out += values[a, b] * box(0, x + along[a], x + along[a + 1]) * box(1, y + down[b], y + down[b + 1])
    return out


def picture(state, turn=0.4):
    """(picture, maps, frame) of one corner with that state, and with what is printed beside it."""
    at, blank = maps(turn), np.zeros((SIZE, SIZE), np.float32)
    frame = frames(at, at.origin, np.zeros((1, 2), bool), 3.0)
    w = windows(blank, at, frame)
    x, y = (w.spot[:, 0] + w.centre.T).astype(int)
    p, u, v = state, w.u.astype(float), w.v.astype(float)
    amplitude = (p[10] + p[13] * u + p[14] * v) * np.sign(p[10])
    blank[y, x] = (drawn(state, w) + amplitude * shade(state, w))[0]
    return blank, at, frame


@pytest.mark.parametrize("contrast", [1, -1])
@pytest.mark.parametrize("turn", [0.4, 2.5])
@pytest.mark.parametrize("blur", [0.6, 1.0, 2.0])
def test_the_fit_finds_every_parameter_beside_print(contrast, turn, blur):
    state = TRUE.copy()
    state[8] = 0  # bleed of what is printed isn't modelled
    state[10] *= contrast
    state[13:] *= contrast
    state[BLUR] += np.log(blur)
    start = START.copy()
    start[CONTRAST] *= contrast
    start[BLUR] += np.log(blur)
    for _ in range(5):  # what is printed is drawn anew at each call
        done = fitted(*picture(state, turn), start, robust=False, drawn=printed(contrast > 0), steps=3)
        start = done.state[0]
    error = np.abs(done.state[0] - state)
    assert error[:6].max() < 3e-4
    assert error[6:9].max() < 3e-3
    assert error[9:].max() < 0.08
    blind = fitted(*picture(state, turn), state, robust=False)
    assert np.abs(blind.state[0] - state)[:2].max() > 2e-3


def test_the_start_knows_what_is_printed():
    state = START.copy()
    state[BLUR], state[CURVE] = np.log(1.2), 0
    grey, at, frame = picture(state)
    found = levels(grey, frame, at, np.array([0.5, 0.8, 1.2, 2.0, 3.2]), printed())
    assert np.argmin(found[:, 0, 0]) == 2
    assert found[2, 0, 0] < 0.02
    np.testing.assert_allclose(found[2, 0, 1:], [120, 80], atol=0.05)


def test_shapes_have_no_more_edges_than_they_show():
    edge, value = shape(np.arange(6.0), np.arange(4.0), np.full((5, 3), 2.0))
    np.testing.assert_array_equal(edge[:, :3], [[0, 5, np.inf], [0, 3, np.inf]])
    assert edge.shape == (2, EDGES)
    np.testing.assert_array_equal(np.argwhere(value), [[1, 1]])
    assert value[1, 1] == 2


def test_windows_end_where_they_are_told_to():
    at = maps()
    ends = np.array([[0.15, 0.5, 0.3, 0.2]])
    grey = np.zeros((SIZE, SIZE), np.uint8)
    w = windows(grey, at, frames(at, at.origin, np.zeros((1, 2), bool), 9.0, ends=ends))
    u, v = w.u[w.mask], w.v[w.mask]
    np.testing.assert_allclose([-u.min(), u.max(), -v.min(), v.max()], ends[0], atol=0.05)
