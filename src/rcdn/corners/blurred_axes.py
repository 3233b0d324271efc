"""Edge directions by a least-squares model of a blurred corner on rings around it."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from rcdn.types import Array

START_BLUR = 1.8
"""First guess of s = √2 × blur, px."""
BLUR_RANGE = (0.4, 20.0)
BELIEF = 100.0
"""Weight of the first guess of log s against the samples, in samples: it decides where noise hides the blur."""
DAMPING = 1e-3
ITERATIONS = 5
LONGEST_STEP = 0.2
MOST_TURN = 0.5
"""Furthest that the fit may turn an axis from its start, radians."""
CLOSEST = 0.05
"""Smallest angle between the two axes, radians."""


def blurred_axes(rings: Array, radius: Array, start: Array) -> Array:
    """Axes (N, 2), radians, from `rings` (N, R, M): means of opposite directions at angles 0, π / M, …

    `radius` (N, R) px; `start` (N, 2) radians, a < b < a + π. Damped Gauss–Newton on m + c erf(d₁/s) erf(d₂/s), d the
    distances to the two edges: two blurred straight edges that cross. Blur makes the narrow sectors of a tilted corner
    look wider than they are, and only a model of it tells. Where the fit gets worse or runs away, `start` stands.
    """
    if not len(start):
        return start
    state = np.column_stack((start, np.full(len(start), np.log(START_BLUR))))
    residual, slopes = _model(rings, radius, state)
    first = (residual**2).sum(axis=1)
    for _ in range(ITERATIONS):
        state = state + np.clip(_step(residual, slopes, state), -LONGEST_STEP, LONGEST_STEP)
        state[:, 2] = np.clip(state[:, 2], *np.log(BLUR_RANGE))
        residual, slopes = _model(rings, radius, state)
    gap = state[:, 1] - state[:, 0]
    good = ((residual**2).sum(axis=1) <= first) & (gap > CLOSEST) & (gap < np.pi - CLOSEST)
    good &= (np.abs(state[:, :2] - start) < MOST_TURN).all(axis=1)
    return np.where(good[:, None], state[:, :2], start)


def _step(residual: Array, slopes: Array, state: Array) -> Array:
    """Change (N, 3) of a, b and log s."""
    normal = np.einsum("nki,nkj->nij", slopes, slopes)
    normal += (DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-9) * np.eye(3)
    pull = np.einsum("nki,nk->ni", slopes, residual)
    belief = BELIEF * (residual**2).mean(axis=1)
    normal[:, 2, 2] += belief
    pull[:, 2] -= belief * (state[:, 2] - np.log(START_BLUR))
    return np.linalg.solve(normal, pull[..., None])[..., 0]


def _model(rings: Array, radius: Array, state: Array) -> tuple[Array, Array]:
    """Residuals (N, K) and slopes (N, K, 3) of the model at `state` (N, 3): a, b, log s; m and c are solved for.

    The slopes are at right angles to what m and c explain (variable projection, Kaufman's approximation).
    """
    count, _, size = rings.shape
    angle = np.arange(size) * (np.pi / size)
    blur = np.exp(state[:, 2])[:, None, None]
    turn = angle - state[:, :2, None, None].swapaxes(0, 1)
    d = radius[:, :, None] * np.sin(turn) / blur
    bell = 2 / np.sqrt(np.pi) * np.exp(-d * d)
    one, other = erf(d)
    by_angle = -bell * (radius[:, :, None] * np.cos(turn) / blur)
    by_blur = -bell * d
    slopes = np.stack((by_angle[0] * other, one * by_angle[1], by_blur[0] * other + one * by_blur[1]), axis=-1)
    shape, slopes = (one * other).reshape(count, -1), slopes.reshape(count, -1, 3)
    data = rings.reshape(count, -1)
    shape = shape - shape.mean(axis=1, keepdims=True)
    data = data - data.mean(axis=1, keepdims=True)
    energy = np.maximum((shape**2).sum(axis=1, keepdims=True), 1e-9)
    scale = (shape * data).sum(axis=1, keepdims=True) / energy
    slopes = scale[..., None] * (slopes - slopes.mean(axis=1, keepdims=True))
    along = np.einsum("nk,nki->ni", shape, slopes) / energy
    return data - scale * shape, slopes - shape[..., None] * along[:, None]
