"""Edge directions by a least-squares model of a blurred corner on rings around it."""

from __future__ import annotations

import numpy as np

from rcdn.corners.erf import erf
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
DONE = 0.002
"""Radians; shorter steps end the fit."""
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
    rings, radius = rings.astype(np.float32), radius.astype(np.float32)
    state = np.column_stack((start, np.full(len(start), np.log(START_BLUR))))
    first, moving = np.full(len(start), np.inf), np.arange(len(start))
    for step in range(ITERATIONS):
        energy, normal, pull = _normal(rings[moving], radius[moving], state[moving])
        if step == 0:
            first = energy
        change = np.clip(_step(energy / rings[0].size, normal, pull, state[moving]), -LONGEST_STEP, LONGEST_STEP)
        state[moving] += change
        state[:, 2] = np.clip(state[:, 2], *np.log(BLUR_RANGE))
        moving = moving[(np.abs(change[:, :2]) > DONE).any(axis=1)]
        if not len(moving):
            break
    last = _normal(rings, radius, state)[0]
    gap = state[:, 1] - state[:, 0]
    good = (last <= first) & (gap > CLOSEST) & (gap < np.pi - CLOSEST)
    good &= (np.abs(state[:, :2] - start) < MOST_TURN).all(axis=1)
    return np.where(good[:, None], state[:, :2], start)


def _step(variance: Array, normal: Array, pull: Array, state: Array) -> Array:
    """Change (N, 3) of a, b and log s."""
    normal += (DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-9) * np.eye(3)
    belief = BELIEF * variance
    normal[:, 2, 2] += belief
    pull[:, 2] -= belief * (state[:, 2] - np.log(START_BLUR))
    return np.linalg.solve(normal, pull[..., None])[..., 0]


def _normal(rings: Array, radius: Array, state: Array) -> tuple[Array, Array, Array]:
    """Squared residuals (N,), normal matrices (N, 3, 3) and right sides (N, 3) of the model at `state` (N, 3): a, b, log s.

    m and c are solved for: what they explain is taken out of data and slopes (variable projection, Kaufman's
    approximation), by elimination in the table of all products of shape, slopes, data and one.
    """
    count, _, size = rings.shape
    angle = np.arange(size) * (np.pi / size)
    turn = (angle - state[:, :2, None]).astype(np.float32)
    reach = (radius * np.exp(-state[:, 2:]).astype(np.float32))[:, :, None]
    columns = np.empty((count, 5, rings[0].size), np.float32)
    d = [(reach * np.sin(turn[:, None, k])).reshape(count, -1) for k in (0, 1)]
    one, other = erf(d[0]), erf(d[1])
    bell = [np.float32(-2 / np.sqrt(np.pi)) * np.exp(-np.minimum(x * x, np.float32(40))) for x in d]
    cross = (bell[0] * other, one * bell[1])
    columns[:, 0] = one * other
    for k in (0, 1):
        columns[:, 1 + k] = cross[k] * (reach * np.cos(turn[:, None, k])).reshape(count, -1)
    columns[:, 3] = cross[0] * d[0] + cross[1] * d[1]
    columns[:, 4] = rings.reshape(count, -1)
    columns -= columns.mean(axis=2, keepdims=True)
    table = (columns @ columns.swapaxes(1, 2)).astype(np.float64)
    energy = np.maximum(table[:, :1, 0], 1e-9)
    scale = table[:, :1, 4] / energy
    table -= table[:, :, :1] * table[:, :1] / energy[..., None]
    return table[:, 4, 4], table[:, 1:4, 1:4] * scale[..., None] ** 2, table[:, 1:4, 4] * scale
