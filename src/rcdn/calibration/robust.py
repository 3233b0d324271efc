"""Robust least squares: outliers among corners and views are detected, left out and reported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.arrow import Arrow
from rcdn.calibration.bundle import Corners3, State, default_free, middles, residuals
from rcdn.calibration.shape import Spread, likeliest, with_spread
from rcdn.calibration.solver import BEHIND, ROUGH_TOLERANCE, solve
from rcdn.calibration.start import Seen
from rcdn.calibration.start import poses as poses_of
from rcdn.calibration.uncertainty import JACKKNIFE, Clustered, clustered
from rcdn.errors import two_digits
from rcdn.geometry import rotation
from rcdn.geometry.median import median
from rcdn.types import Array
from rcdn.types.arrays import Real

GATE = 4.5
"""standard deviations of a corner's distance above which it is an outlier (one in 25,000 by chance)"""
CROOKED = 5.0
"""× the usual scatter: a view whose median residual is larger is left out"""
TOO_MANY = 0.3
"""share of outliers above which the whole view is left out"""
HOPEFUL = 10.0
"""× the median distance of a view's corners: the second of the two poses that a plane allows is not tried above it"""
ODD = 3.0
"""× the usual median distance of corners: a view above it is weighted less in the initial fit, and its pose is
estimated anew"""
ROUNDS, SETTLED = 20, 0.02
"""most iterations; relative change of the corners' weights and of the prior's spreads below which they end, if no
corner becomes an outlier or an inlier"""
LEAST_NOISE = 1e-4
"""px; least standard deviation of corners"""
CLOSE = 1e-9
"""relative error of a standard deviation that is found by bisection"""
MEDIAN = 2 * np.log(2.0)
"""median of the squared length of a whitened residual"""


@dataclass(frozen=True, eq=False)
class Fit:
    """`state` and `arrow` of the solution; `residuals` (N, 2) px; `used` (N,) corners; `reasons` for each frame that
    was left out, "" if used; `noise`, px of one axis in addition to sigma; `weight` (N,) 1 / px; `scale`: sum of
    squared whitened residuals divided by the degrees of freedom; `clustered`: the covariance of the shared parameters
    from the scatter between whole views; `free` (K,): which shared parameters were estimated."""

    state: State
    arrow: Arrow
    residuals: Array
    used: Array
    reasons: tuple[str, ...]
    noise: float
    weight: Array
    scale: float
    clustered: Clustered
    free: Array


def initial_fit(start: State, corners: Corners3, sigma: Array, free: Array, turn: bool = True) -> tuple[State, float]:
    """An initial fit with a loss that limits the influence of outliers, and the noise of one axis that it leaves, px.

    `turn`: poses may change to the other of the two that a plane allows.
    """
    state, noise = start, _median_noise(residuals(start, corners), np.zeros(len(sigma)))
    for _ in range(2):
        calm = _calm(residuals(state, corners), corners.frame, len(start.poses))
        state = solve(state, corners, _weights(noise, sigma) * calm, free, "soft_l1", tolerance=ROUGH_TOLERANCE).state
        noise = _median_noise(residuals(state, corners), sigma)
        if turn:
            state = _better_poses(state, corners, _weights(noise, sigma))
    return state, noise


def _calm(gaps: Array, frame: Array, frames: int) -> Real[Array, " n"]:
    """(N,) weights ≤ 1 of corners by their view: a view with a large median residual must not dominate the estimate of
    the lens."""
    px = np.minimum(_medians(gaps, frame, frames), BEHIND)
    return np.minimum(1, (ODD * np.median(px[np.unique(frame)]) / np.maximum(px, 1e-12)) ** 2)[frame]


def _better_poses(state: State, corners: Corners3, weight: Array) -> State:
    """`state` with other poses where they fit better: the second of the two that a plane allows, and that from the
    viewing rays under this lens.

    The first is tried if its corners are not hopelessly far off, the second if a view's corners are farther off than
    usual.
    """
    frames = len(state.poses)
    near = _medians(residuals(state, corners), corners.frame, frames)
    flipped = _flipped(state, corners, np.unique(corners.frame))
    state = _where_better(
        state, flipped, _medians(residuals(flipped, corners), corners.frame, frames) <= HOPEFUL * near, corners, weight
    )
    odd = near > ODD * np.median(near[np.unique(corners.frame)])
    if len(state.cameras) > 1 or not odd.any():
        return state
    return _where_better(state, _anew(state, corners, np.flatnonzero(odd)), odd, corners, weight)


def _where_better(state: State, other: State, tried: Array, corners: Corners3, weight: Array) -> State:
    """`state`, with the poses of `other`, refined from there, for those of the frames `tried` (F,) in which they fit
    better."""
    mine = np.flatnonzero(tried[corners.frame])
    if not len(mine):
        return state
    some, firm = corners.take(mine), weight[mine]
    nothing = default_free(state, lens=False)
    other = solve(other, some, firm, nothing, "soft_l1", iterations=12, tolerance=ROUGH_TOLERANCE).state
    costs = []
    for each in (state, other):
        square = np.nan_to_num((residuals(each, some) * firm[:, None]) ** 2, nan=BEHIND**2)
        costs.append(np.bincount(some.frame, (np.sqrt(1 + square / 4) - 1).sum(axis=1), len(state.poses)))
    better = costs[1] < costs[0]
    return replace(state, poses=np.where(better[:, None, None], other.poses, state.poses))


def _anew(state: State, corners: Corners3, frames: Array) -> State:
    """`state` with the poses of `frames` estimated from their viewing rays."""
    seen = [Seen(corners.board[corners.frame == f], corners.xy[corners.frame == f]) for f in frames]
    T, out = poses_of(state.cameras[0], seen), state.poses.copy()
    good = np.isfinite(T).all(axis=(1, 2))
    out[frames[good]] = T[good]
    return replace(state, poses=out)


def _medians(gaps: Real[Array, "n 2"], frame: Array, frames: int) -> Real[Array, " f"]:
    """(F,) median length of each frame's `gaps` (N, 2), px; infinite where the camera cannot see most corners, 0
    without corners."""
    far = np.nan_to_num(np.linalg.norm(gaps, axis=1), nan=np.inf)
    return np.array([median(far[rows]) if len(rows) else 0.0 for rows in _rows(frame, frames)])


def _rows(frame: Array, frames: int) -> list[Array]:
    """For each of the frames, its corners."""
    return np.split(np.argsort(frame, kind="stable"), np.cumsum(np.bincount(frame, minlength=frames))[:-1])


def _flipped(state: State, corners: Corners3, frames: Array) -> State:
    """The poses of `frames` with their boards' normals mirrored about the line of sight to the boards' centres."""
    poses, places = state.poses.copy(), middles(state, corners)[frames]
    R, t = poses[frames, :3, :3], poses[frames, :3, 3]
    middle = (R @ places[:, :, None])[..., 0] + t
    sight, normal = middle / np.linalg.norm(middle, axis=1, keepdims=True), R[:, :, 2]
    axis = np.cross(normal, sight)
    sine, cosine = np.linalg.norm(axis, axis=1), (normal * sight).sum(axis=1)
    Q = rotation(axis * (2 * np.arctan2(sine, cosine) / np.maximum(sine, 1e-12))[:, None])  # twice the angle between
    poses[frames, :3, :3], poses[frames, :3, 3] = Q @ R, middle - (Q @ (middle - t)[:, :, None])[..., 0]
    return replace(state, poses=poses)


def fit(
    start: State,
    noise: float,
    corners: Corners3,
    sigma: Real[Array, " n"],
    free: Array,
    cluster: Real[Array, " f"] | None = None,
    spacing: float = 1.0,
    power: float = JACKKNIFE,
) -> Fit:
    """Fit the `free` (K,) shared parameters and all poses to `corners` with standard deviations `sigma` (N,) px, some
    of them outliers.

    Starts from an initial fit and its `noise`, and iterates until nothing changes: classify corners and views as
    inliers or outliers, solve the least squares of the inliers, estimate their noise and, if the board's shape is free,
    the spreads of its prior. `cluster` (F,): errors of frames with the same number may be correlated (default: each
    frame by itself). `spacing`: side of a square, m. `power`: see `clustered`.
    """
    shaped = bool(free[len(free) - start.shape.size :].any())
    spread = Spread.first(spacing)
    state = with_spread(start, spread) if shaped else start
    used, reasons = np.zeros(len(corners), bool), [""] * len(start.poses)
    for _ in range(ROUNDS):
        used_before, spread_before, noise_before = used, spread, noise
        used, reasons = _agreeing(residuals(state, corners), corners.frame, noise, sigma, len(start.poses))
        weight = np.where(used, _weights(noise, sigma), 0.0)
        solution = solve(state, corners, weight, free)
        state = _with_poses(solution.state, corners, _weights(noise, sigma), [f for f, r in enumerate(reasons) if r])
        noise = _noise(
            residuals(state, corners)[used], sigma[used], _unknowns(state, solution.arrow, corners, used, free)
        )
        if shaped:
            own = solution.arrow.covariance[-state.shape.size :, -state.shape.size :]
            spread = likeliest(state.shape, own, spread, spacing)
            state = with_spread(state, spread)
        settled = np.allclose(_weights(noise, sigma), _weights(noise_before, sigma), rtol=SETTLED, atol=0)
        if settled and (used == used_before).all() and spread.near(spread_before, SETTLED):
            break
    gaps = residuals(state, corners)
    square = float(((gaps[used] * weight[used, None]) ** 2).sum())
    scale = square / max(2 * int(used.sum()) - _unknowns(state, solution.arrow, corners, used, free), 1)
    honest = clustered(state, corners, weight, free, solution.arrow, scale, cluster, power)
    return Fit(state, solution.arrow, gaps, used, tuple(reasons), noise, weight, scale, honest, free)


def _with_poses(state: State, corners: Corners3, weight: Array, frames: list[int]) -> State:
    """`state` with the poses of `frames`, which the solution does not use, fitted to their corners."""
    mine = np.flatnonzero(np.isin(corners.frame, frames))
    if not len(mine):
        return state
    nothing = default_free(state, lens=False)
    state = solve(state, corners.take(mine), weight[mine], nothing, "soft_l1", iterations=12).state
    return _better_poses(state, corners.take(mine), weight[mine])


def _unknowns(state: State, arrow: Arrow, corners: Corners3, used: Array, free: Array) -> float:
    """Effective number of unknowns: of a parameter with a prior only the share that the corners determine counts."""
    precision = state.beforehand.precision[np.ix_(free, free)]
    held = float(np.sum(precision * arrow.covariance))
    return 6 * len(np.unique(corners.frame[used])) + int(free.sum()) - held


def _weights(noise: float | Array, sigma: Array) -> Array:
    return np.asarray(1 / np.hypot(noise, sigma))


def _agreeing(gaps: Array, frame: Array, noise: float, sigma: Array, frames: int) -> tuple[Array, list[str]]:
    """Which corners are inliers, and for each frame the reason why it is an outlier as a whole, or "".

    The errors of the corners of one view are correlated (paper bends differently in every picture): a corner is
    compared with the scatter of its own view where that is larger than the usual one.
    """
    far = np.nan_to_num(np.linalg.norm(gaps, axis=1), nan=np.inf)
    px = _medians(gaps, frame, frames)
    rows = _rows(frame, frames)
    stated = np.array([median(sigma[mine]) if len(mine) else 0.0 for mine in rows])
    beyond = np.sqrt(np.maximum(np.minimum(px, BEHIND) ** 2 / MEDIAN - stated**2, 0.0))
    own = np.clip(beyond, noise, CROOKED * noise)
    good = far * _weights(own[frame], sigma) < GATE
    miss = far * _weights(noise, sigma)
    reasons = [""] * frames
    for f, mine in enumerate(rows):
        share = 1 - float(good[mine].mean()) if len(mine) else 1.0
        if not np.isfinite(px[f]):
            reasons[f] = "no pose fits its corners"
        elif len(mine) and median(miss[mine]) > CROOKED * np.sqrt(MEDIAN):
            others = np.median(np.delete(px, f)) if frames > 1 else 0.0
            reasons[f] = (
                f"its corners lie {two_digits(px[f])} px from where this camera would see them, "
                f"those of other views {two_digits(others)} px"
            )
        elif share > TOO_MANY:
            reasons[f] = f"{share:.0%} of its corners disagree with the other views"
    lost = np.array([bool(r) for r in reasons])
    return good & ~lost[frame], reasons


def _median_noise(gaps: Array, sigma: Real[Array, " n"]) -> float:
    """Noise of one axis in addition to `sigma` (N,), px, from the median of the residuals, which is robust to
    outliers."""
    square = (gaps**2).sum(axis=1)
    seen = np.isfinite(square)
    if not seen.any():
        return 1.0
    square, known = square[seen], sigma[seen] ** 2

    def excess(noise: float) -> float:
        return median(square / (noise**2 + known)) - MEDIAN

    return _root(excess, float(np.sqrt(median(square) / MEDIAN)))


def _noise(gaps: Array, sigma: Real[Array, " n"], unknowns: float) -> float:
    """Noise of one axis in addition to `sigma` (N,), px, for which the sum of squared whitened residuals equals the
    degrees of freedom."""
    square, freedom = (gaps**2).sum(axis=1), max(2 * len(gaps) - unknowns, 1)

    def excess(noise: float) -> float:
        return float((square / (noise**2 + sigma**2)).sum()) - freedom

    return _root(excess, float(np.sqrt(square.sum() / freedom)))


def _root(excess: Callable[[float], float], most: float) -> float:
    """Root of the decreasing function `excess` between LEAST_NOISE and just above `most`, by bisection; the nearer end
    of the interval if there is none."""
    low, high = LEAST_NOISE, max(most * 1.001, 2 * LEAST_NOISE)
    while high - low > CLOSE * high:
        middle = (low + high) / 2
        low, high = (low, middle) if excess(middle) <= 0 else (middle, high)
    return high
