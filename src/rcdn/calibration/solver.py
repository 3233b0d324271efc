"""Least squares for cameras, poses and a board's shape: Levenberg–Marquardt on normal equations from which the poses
are eliminated.

The normal matrix has arrow structure: one 6 × 6 block for each frame (the pose of its board) and a border for the
parameters that all frames share (intrinsics, poses of the other cameras, how late they are, the board's shape). The
poses are eliminated by the Schur complement (Triggs et al., Bundle Adjustment, 2000, section 6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rcdn.calibration.arrow import Arrow
from rcdn.calibration.bundle import (
    Corners3,
    State,
    default_free,
    linearise,
    linearise_one,
    parameters_of,
    residuals,
)
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Real

ITERATIONS, TOLERANCE, ROUGH_TOLERANCE = 60, 1e-9, 1e-6
"""most steps; relative decrease of the cost below which the iteration ends; the same where parameters need be right to
some hundredths of a standard deviation only, as in an initial fit"""
DAMPING, STRONGEST = 1e-6, 1e8
"""initial damping of Levenberg–Marquardt, and the damping at which it stops"""
SHORTEST, LONGEST, UNCHANGED = 0.1, 4.0, 1.25
"""lengths of a step, × the whole one, between which the minimum along it is tried, unless it is this near to the whole
one"""
BEHIND = 1e3
"""whitened residual assigned to a corner that the camera cannot see"""
FARTHEST = 1e8
"""whitened residual above which a corner is treated as one that the camera cannot see: its square must not overflow"""
SCALE = 2.0
"""whitened residual above which the loss `soft_l1` grows linearly"""

MANY = 100
"""number of shared parameters from which on the rows of each axis are multiplied separately"""

_weighted, _normal_blocks = bind("rcdn_weighted"), bind("rcdn_normal_blocks")
_weighted_cost = bind("rcdn_cost")


def _flat(jacobian: Real[Array, "n 2 k"]) -> Array:
    """(2 N, K) the rows of all corners."""
    return jacobian.reshape(2 * len(jacobian), jacobian.shape[2])


@dataclass(frozen=True, eq=False)
class Linear:
    """The problem linearised at one state: whitened residuals `gaps` (N, 2), observed − projected, Jacobians `by_frame`
    (N, 2, 6) and `shared` (N, 2, K') of the free parameters, `frame` (N,) among F `frames`; `precision` (K', K') of the
    prior and its negative gradient `pull` (K',)."""

    gaps: Array
    by_frame: Array
    shared: Array
    frame: Array
    frames: int
    precision: Array
    pull: Array

    @classmethod
    def of(cls, state: State, corners: Corners3, weight: Array, free: Array, loss: str = "linear") -> Linear:
        """Corners that a camera cannot see contribute nothing."""
        prior = state.beforehand
        pull = -prior.gradient(state.values)[free]
        xy, by_frame, shared = linearise(state, corners)
        return cls(
            *_whitened(corners.xy - xy, by_frame, shared if free.all() else shared[:, :, free], weight, loss),
            corners.frame,
            len(state.poses),
            prior.precision[np.ix_(free, free)],
            pull,
        )

    @classmethod
    def of_camera(
        cls, state: State, corners: Corners3, weight: Array, free: Array, loss: str, camera: int
    ) -> tuple[Linear, Array]:
        """For corners of one camera, without a prior: with those of the free parameters alone that it tells of, and
        their numbers (K',) among the free ones."""
        relevant = parameters_of(state, camera)
        xy, by_frame, shared = linearise_one(state, corners, camera)
        own = np.flatnonzero(relevant[free])
        mine = free[relevant]
        parts = _whitened(corners.xy - xy, by_frame, shared if mine.all() else shared[:, :, mine], weight, loss)
        many = len(own)
        return cls(*parts, corners.frame, len(state.poses), np.zeros((many, many)), np.zeros(many)), own

    @property
    def normal(self) -> Normal:
        """The normal equations, including the prior."""
        many = self.shared.shape[2]
        blocks, pull = np.zeros((self.frames, 6, 6 + many)), np.zeros((self.frames, 6))
        whole, shared = self.added_to(blocks, pull, np.arange(many))
        return Normal(blocks, whole + self.precision, (pull, shared + self.pull))

    def added_to(self, blocks: Array, pull: Array, columns: Array) -> tuple[Array, Array]:
        """Add to the frames' `blocks` (F, 6, 6 + K) and their part `pull` (F, 6) of the gradient what these corners
        tell, the numbers (K',) of their parameters being `columns`. Returns the same of the parameters: (K', K') and
        (K',)."""
        room = np.empty(6 * (6 + len(columns)))
        frame, numbers = (np.ascontiguousarray(which, np.int64) for which in (self.frame, columns))
        _normal_blocks(frame, self.gaps, self.by_frame, self.shared, numbers, room, blocks, pull)
        return _gram(self.shared), _flat(self.shared).T @ self.gaps.ravel()


def _gram(shared: Real[Array, "n 2 k"]) -> Real[Array, "k k"]:
    """Gram matrix (K, K) of the columns of `shared`. Many parameters are mostly control points of a smooth correction,
    each of which moves corners along one axis only: then each axis is multiplied without the columns that are zero."""
    if shared.shape[2] < MANY:
        flat = _flat(shared)
        return np.asarray(flat.T @ flat)
    out = np.zeros((shared.shape[2], shared.shape[2]))
    for axis in range(2):
        own = np.flatnonzero(shared[:, axis].any(axis=0))
        rows = shared[:, axis, own]
        out[np.ix_(own, own)] += rows.T @ rows
    return out


def _whitened(gaps: Array, by_frame: Array, shared: Array, weight: Array, loss: str) -> tuple[Array, Array, Array]:
    """Residuals and Jacobians times the corners' weights, zero for corners that a camera cannot see; changed in place,
    but for `shared` if it isn't contiguous."""
    shared = np.ascontiguousarray(shared)
    _weighted(np.ascontiguousarray(weight, float), FARTHEST, SCALE * (loss == "soft_l1"), gaps, by_frame, shared)
    return gaps, by_frame, shared


AT_ONCE = 4_000_000
"""elements of the shared parameters' Jacobian that are kept in memory at once: larger problems are summed in parts"""


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations: `blocks` (F, 6, 6 + K') and `whole` (K', K') as in `Arrow.of`; `gradient` (F, 6) and (K',), the
    negative gradient of half the cost."""

    blocks: Array
    whole: Array
    gradient: tuple[Array, Array]

    @classmethod
    def of(cls, state: State, corners: Corners3, weight: Array, free: Array, loss: str = "linear") -> Normal:
        """At one state, as `Linear.of`; the memory is proportional to frames × shared parameters, not to corners ×
        shared parameters."""
        each = max(AT_ONCE // (2 * sum(state.counts)), 1)
        if len(state.cameras) > 1:
            return cls._by_camera(state, corners, weight, free, loss, each)
        if len(corners) <= each:
            return Linear.of(state, corners, weight, free, loss).normal
        prior, many = state.beforehand, int(free.sum())
        blocks, whole = np.zeros((len(state.poses), 6, 6 + many)), prior.precision[np.ix_(free, free)].copy()
        by_frame, shared = np.zeros((len(state.poses), 6)), -prior.gradient(state.values)[free]
        for at in range(0, len(corners), each):
            some = slice(at, at + each)
            part = Linear.of(state, corners.take(some), weight[some], free, loss)
            mine = part.normal
            blocks += mine.blocks
            whole += mine.whole - part.precision
            by_frame += mine.gradient[0]
            shared += mine.gradient[1] - part.pull
        return cls(blocks, whole, (by_frame, shared))

    @classmethod
    def _by_camera(cls, state: State, corners: Corners3, weight: Array, free: Array, loss: str, each: int) -> Normal:
        """The same, camera by camera: a corner tells of its own camera's lens, place and lateness and of the
        board's shape, and nothing of other cameras."""
        prior, many = state.beforehand, int(free.sum())
        blocks, whole = np.zeros((len(state.poses), 6, 6 + many)), prior.precision[np.ix_(free, free)].copy()
        by_frame, shared = np.zeros((len(state.poses), 6)), -prior.gradient(state.values)[free]
        for c, mine in corners.seen_by.items():
            firm = weight[corners.rows[c]]
            for at in range(0, len(mine), each):
                some = slice(at, at + each)
                linear, own = Linear.of_camera(state, mine.take(some), firm[some], free, loss, c)
                part, pull = linear.added_to(blocks, by_frame, own)
                whole[np.ix_(own, own)] += part
                shared[own] += pull
        return cls(blocks, whole, (by_frame, shared))

    def arrow(self, damping: float = 0.0) -> Arrow:
        """The factor of the normal matrix."""
        return Arrow.of(self.blocks, self.whole, damping)


def without_pose(by_pose: Array, shared: Array, gaps: Array) -> tuple[Array, Array]:
    """Whitened Jacobian (2 M, K) and residuals (2 M,) of one view without what its pose takes up; of `by_pose`
    (M, 2, 6), `shared` (M, 2, K) and `gaps` (M, 2)."""
    Q, _ = np.linalg.qr(by_pose.reshape(-1, 6))
    J, e = shared.reshape(len(Q), shared.shape[-1]), gaps.ravel()
    return J - Q @ (Q.T @ J), e - Q @ (Q.T @ e)


@dataclass(frozen=True, eq=False)
class Solution:
    """`state` at the minimum of the cost of `corners` with `weight` (N,), under the `free` (K,) parameters."""

    state: State
    corners: Corners3
    weight: Array
    free: Array

    @cached_property
    def arrow(self) -> Arrow:
        """The factor of the covariance at the minimum, if the weights are right."""
        return Normal.of(self.state, self.corners, self.weight, self.free).arrow()


@np.errstate(under="ignore")  # of squares of what is all but 0
def solve(
    start: State,
    corners: Corners3,
    weight: Real[Array, " n"],
    free: Array | None = None,
    loss: str = "linear",
    iterations: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Solution:
    """The `State` that minimises the sum of squares of `weight` (N,) × (observed − projected) (N, 2) plus the cost of
    its prior, from `start`.

    `free` (K,) bool: the shared parameters that may change (default: those of the lenses). `loss`: linear or soft_l1
    (for each axis, with scale 2). `tolerance`: relative decrease of the cost below which the iteration ends. A
    frame without corners keeps its pose.
    """
    free = default_free(start) if free is None else free
    state = replace(start, prior=start.beforehand)  # computed once
    cost, damping = _cost(state, corners, weight, loss), DAMPING
    for _ in range(iterations):
        here = Normal.of(state, corners, weight, free, loss)
        other, less, damping = _step(state, here, cost, damping, corners, weight, free, loss)
        gain = (cost - less) / max(cost, 1e-300)
        state, cost = other, less
        if gain < tolerance:
            break
    return Solution(replace(state, prior=start.prior), corners, weight, free)


def _step(
    state: State, here: Normal, cost: float, damping: float, corners: Corners3, weight: Array, free: Array, loss: str
) -> tuple[State, float, float]:
    """The next state, its cost and the next damping; `state` itself if no step lowers the cost."""
    gradient = here.gradient
    while damping < STRONGEST:
        by_frame, some = here.arrow(damping).solve(*gradient)
        shared = np.zeros(len(free))
        shared[free] = some
        if np.isfinite(some).all() and np.isfinite(by_frame).all():
            slope = 2 * float((by_frame * gradient[0]).sum() + some @ gradient[1])

            def at(length: float, by_frame: Array = by_frame, shared: Array = shared) -> tuple[State, float]:
                other = state.moved(length * by_frame, length * shared)
                return other, _cost(other, corners, weight, loss)

            other, less = _on_parabola(at, cost, slope)
            if less <= cost:
                return other, less, max(damping / 10, 1e-9)
        damping *= 10
    return state, cost, DAMPING


def _on_parabola(at: Callable[[float], tuple[State, float]], cost: float, slope: float) -> tuple[State, float]:
    """The state and cost `at` the whole step, or at the minimum of the parabola through the `cost` before it, with
    the decrease `slope` there, and that after it, if this is lower.

    Where corners hardly determine a direction, residuals times second derivatives weigh as much as its Gauss–Newton
    curvature; whole steps overshoot the minimum again and again then.
    """
    other, less = at(1.0)
    curvature = slope - (cost - less)
    length = slope / (2 * curvature) if curvature > 0 else 1.0
    if not SHORTEST < length < LONGEST or 1 / UNCHANGED < length < UNCHANGED:
        return other, less
    return min((other, less), at(length), key=lambda found: found[1])


def _cost(state: State, corners: Corners3, weight: Array, loss: str) -> float:
    total, soft = np.empty(1), SCALE * (loss == "soft_l1")
    _weighted_cost(residuals(state, corners), np.ascontiguousarray(weight, float), FARTHEST, BEHIND, soft, total)
    return float(total[0]) + state.beforehand.cost(state.values)
