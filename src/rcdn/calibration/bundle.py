"""Cameras, poses and a board's shape from corners by least squares. SciPy solves; here are residuals and exact derivatives.

The normal matrix is an arrow: a block of 6 a frame (a board's pose) and a rim of what all frames share (lenses, the second camera's
place, the board's warp). Its Cholesky factor gives coordinates in which the problem is nearly a sphere, so that a few
steps of an iterative solver are enough (Triggs et al., Bundle Adjustment, 2000), and later every covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_array, vstack

from rcdn.geometry import cross_matrix, project_with_slopes, rotation, rotation_slope
from rcdn.types import Array, Camera

RIDGE = 1e-10
"""× the largest of a block's diagonal: keeps what nothing determines from stopping the solver; its variance is huge then"""
STEPS, REPEATS, ENOUGH = 8, 12, 1e-7
"""evaluations before the coordinates are made anew; how often; the share of the cost that is too little to go on for"""
DENOMINATOR = 1.0
"""standard deviation of k4, k5 and k6 of a rational lens before any corner is seen"""
BEHIND = 1e3
"""whitened residual of a corner that the camera can't see"""


@dataclass(frozen=True, eq=False)
class Corners3:
    """N corners: `frame` (N,) of the board's pose and `camera` (N,) that saw it, integers; `board` (N, 2) on the board, m;
    `xy` (N, 2) px; `bend` (N, 2) what one metre of each warp raises it by."""

    frame: Array
    camera: Array
    board: Array
    xy: Array
    bend: Array

    def __len__(self) -> int:
        return len(self.xy)

    def take(self, index: Any) -> Corners3:
        """The corners at `index`; frames keep their numbers."""
        return Corners3(self.frame[index], self.camera[index], self.board[index], self.xy[index], self.bend[index])


@dataclass(frozen=True, eq=False)
class State:
    """All unknowns: `cameras`; `poses` (F, 4, 4) of the boards in the first camera; `rig` (C, 4, 4) takes the first camera's
    coordinates to each one's (the first: identity); `warp` (2,) m."""

    cameras: tuple[Camera, ...]
    poses: Array
    rig: Array
    warp: Array

    @classmethod
    def mono(cls, camera: Camera, poses: Array, warp: Array | None = None) -> State:
        """One camera."""
        return cls((camera,), poses, np.eye(4)[None], np.zeros(2) if warp is None else warp)

    @property
    def belief(self) -> tuple[Array, Array]:
        """What is held of the shared parameters before any corner: their values (K,) that should be near 0, and 1 / standard deviation (0: nothing).

        A rational lens' numerator and denominator may share a factor that no picture tells: the denominator is held to be small.
        """
        values = [c.parameters for c in self.cameras]
        firm = [np.zeros(len(c.parameters)) for c in self.cameras]
        for camera, mine in zip(self.cameras, firm, strict=True):
            if camera.model == "rational":
                mine[-3:] = 1 / DENOMINATOR
        rest = np.zeros(sum(self.counts[-2:]))
        return np.concatenate([*values, rest]), np.concatenate([*firm, rest])

    @property
    def counts(self) -> tuple[int, ...]:
        """How many shared parameters each camera has, the rig, and the warp."""
        return (*(len(c.parameters) for c in self.cameras), 6 * (len(self.cameras) - 1), 2)

    def moved(self, by_frame: Array, shared: Array) -> State:
        """After small motions `by_frame` (F, 6) of the poses and the change `shared` (K,) of what all share."""
        parts = np.split(shared, np.cumsum(self.counts)[:-1])
        cameras = tuple(c.with_parameters(c.parameters + d) for c, d in zip(self.cameras, parts[:-2], strict=True))
        rig = self.rig.copy()
        rig[1:] = _move(rig[1:], parts[-2].reshape(-1, 6))
        return State(cameras, _move(self.poses, by_frame), rig, self.warp + parts[-1])


@dataclass(frozen=True, eq=False)
class Moved:
    """Motions from a start: `frames` (F, 6) of the poses, `rig` (C − 1, 6) of the other cameras."""

    frames: Array
    rig: Array


def _move(T: Array, motions: Array) -> Array:
    """Poses (F, 4, 4) after motions (F, 6): a rotation about the origin of the camera, then a shift."""
    out, R = T.copy(), rotation(motions[:, :3])
    out[:, :3, :3] = R @ T[:, :3, :3]
    out[:, :3, 3] = (R @ T[:, :3, 3, None])[..., 0] + motions[:, 3:]
    return out


def residuals(state: State, corners: Corners3) -> Array:
    """(N, 2) observed − projected, px; NaN where the camera can't see."""
    return corners.xy - linearise(state, corners)[0]


def linearise(state: State, corners: Corners3, moved: Moved | None = None) -> tuple[Array, Array, Array]:
    """Pixels (N, 2), their slopes in the frames' motions (N, 2, 6) and in what all share (N, 2, K).

    Slopes in motions from where the state is or, with `moved`, in the motions that have led to it.
    """
    board = np.column_stack([corners.board, corners.bend @ state.warp])
    T, cam, offsets = state.poses[corners.frame], corners.camera, np.cumsum([0, *state.counts])
    first = (T[:, :3, :3] @ board[:, :, None])[..., 0] + T[:, :3, 3]
    points = (state.rig[cam, :3, :3] @ first[:, :, None])[..., 0] + state.rig[cam, :3, 3]
    by_motion = _motion_slopes(first, None if moved is None else moved.frames[corners.frame])
    xy, by_frame = np.full((len(corners), 2), np.nan), np.zeros((len(corners), 2, 6))
    shared = np.zeros((len(corners), 2, offsets[-1]))
    for c, camera in enumerate(state.cameras):
        of = np.flatnonzero(cam == c)
        xy[of], by_point, shared[of, :, offsets[c] : offsets[c + 1]] = project_with_slopes(camera, points[of])
        in_first = by_point @ state.rig[c, :3, :3]
        by_frame[of] = in_first @ by_motion[of]
        if c:
            at = offsets[-3] + 6 * (c - 1)
            motion = None if moved is None else np.broadcast_to(moved.rig[c - 1], (len(of), 6))
            shared[of, :, at : at + 6] = by_point @ _motion_slopes(points[of], motion)
        normal = (in_first @ T[of, :3, 2, None])[..., 0]
        shared[of, :, offsets[-2] :] = normal[:, :, None] * corners.bend[of, None, :]
    return xy, by_frame, shared


def _motion_slopes(points: Array, motions: Array | None) -> Array:
    """∂point/∂motion (N, 3, 6) of `points` (N, 3) that `motions` (N, 6; None: none) have led to."""
    out = np.zeros((len(points), 3, 6))
    out[:, [0, 1, 2], [3, 4, 5]] = 1.0
    if motions is None:
        out[:, :, :3] = -cross_matrix(points)
    else:
        out[:, :, :3] = -cross_matrix(points - motions[:, 3:]) @ rotation_slope(motions[:, :3])
    return out


@dataclass(frozen=True, eq=False)
class Arrow:
    """Inverse Cholesky factor of the normal matrix, as blocks: x_frame = `own` y_frame − `reach` x_shared, x_shared = `rim` y_shared.

    `own` (F, 6, 6), `reach` (F, 6, K), `rim` (K, K); with unit noise the covariance of x is the factor times its transpose.
    """

    own: Array
    reach: Array
    rim: Array

    @classmethod
    def of(cls, by_frame: Array, shared: Array, frame: Array, frames: int, firm: Array) -> Arrow:
        """From whitened slopes (N, 2, 6) and (N, 2, K), and 1 / standard deviation `firm` (K,) of the shared ones before."""
        joint = np.concatenate([by_frame, shared], axis=2)
        blocks = np.zeros((frames, 6, 6 + shared.shape[2]))
        np.add.at(blocks, frame, np.einsum("nia,nib->nab", by_frame, joint, optimize=True))
        own = _inverse_factor(blocks[:, :, :6])
        reach = own @ (own.transpose(0, 2, 1) @ blocks[:, :, 6:])
        flat = shared.reshape(2 * len(shared), shared.shape[2])
        whole = flat.T @ flat + np.diag(firm**2)
        rim = whole - np.einsum("fak,fal->kl", blocks[:, :, 6:], reach, optimize=True)
        return cls(own, reach, _inverse_factor(rim[None], np.diag(whole))[0])

    def apply(self, y: Array) -> tuple[Array, Array]:
        """(F, 6) and (K,) of coordinates `y` (6 F + K,)."""
        frames = len(self.own)
        shared = self.rim @ y[6 * frames :]
        own = (self.own @ y[: 6 * frames].reshape(frames, 6, 1))[..., 0]
        return own - self.reach @ shared, shared

    def slopes(self, by_frame: Array, shared: Array, frame: Array) -> tuple[Array, Array]:
        """Slopes in `y`: (N, 2, 6) of the corner's frame and (N, 2, K) of the rim."""
        return by_frame @ self.own[frame], (shared - by_frame @ self.reach[frame]) @ self.rim


def _inverse_factor(blocks: Array, whole: Array | None = None) -> Array:
    """Inverse of the upper Cholesky factor of symmetric `blocks` (F, n, n); a ridge where they are singular.

    `whole` (n,): the diagonal before other unknowns were eliminated; what is left of it may be all rounding. What no corner
    tells of gets zeros: it won't move.
    """
    if not blocks.shape[-1]:
        return blocks
    diagonal = np.einsum("fii->fi", blocks)
    floor = 1e-13 * (diagonal if whole is None else whole[None])
    told = floor > 0
    unit = np.sqrt(np.where(told, np.maximum(diagonal, floor), 1.0))
    scaled = blocks / (unit[:, :, None] * unit[:, None, :])
    values, vectors = np.linalg.eigh((scaled + scaled.transpose(0, 2, 1)) / 2)
    root = np.sqrt(np.maximum(values, RIDGE))[:, :, None] * vectors.transpose(0, 2, 1)
    inverse = np.linalg.inv(np.linalg.qr(root, mode="r")) / unit[:, :, None]
    return np.asarray(inverse * told[:, :, None] * told[:, None, :])


@dataclass(frozen=True, eq=False)
class Solution:
    """`state` at the least squares; `arrow` there: with the weights' noise the covariance's factor."""

    state: State
    arrow: Arrow


def solve(
    start: State,
    corners: Corners3,
    weight: Array,
    free: Array | None = None,
    loss: str = "linear",
    repeats: int = REPEATS,
) -> Solution:
    """The `State` that makes the sum of squares of `weight` (N,) × (observed − projected) (N, 2) least, from `start`.

    `free` (K,) bool: which shared parameters may change (default: the lenses'). `loss`: SciPy's, with its scale at 2. The solver starts again from
    where it is, at most `repeats` times, with coordinates made anew. A frame without corners keeps its pose.
    """
    free = default_free(start) if free is None else free
    state, arrow = start, _arrow(start, corners, weight, free)
    for _ in range(repeats):
        state, gain = _descend(state, corners, weight, free, arrow, loss)
        arrow = _arrow(state, corners, weight, free)
        if gain < ENOUGH:
            break
    return Solution(state, arrow)


def _arrow(state: State, corners: Corners3, weight: Array, free: Array) -> Arrow:
    _, by_frame, shared = linearise(state, corners)
    by_frame, shared = (np.nan_to_num(a) * weight[:, None, None] for a in (by_frame, shared[:, :, free]))
    return Arrow.of(by_frame, shared, corners.frame, len(state.poses), state.belief[1][free])


def _descend(
    start: State, corners: Corners3, weight: Array, free: Array, arrow: Arrow, loss: str
) -> tuple[State, float]:
    """The state after a few steps, and the share of the cost that they took away."""
    function, slope = _problem(start, corners, weight, free, arrow)
    here = np.zeros(6 * len(start.poses) + int(free.sum()))
    step = float(np.linalg.norm(slope(here).T @ function(here)))
    # SciPy takes its first trust region from the length of the start: let it be that of the first step
    offset = np.full(len(here), max(step, 1.0) / np.sqrt(max(len(here), 1)))
    settings = {
        "loss": loss,
        "f_scale": 2.0,
        "tr_solver": "lsmr",
        "tr_options": {"regularize": False, "atol": 1e-4, "btol": 1e-4},
    }
    before = _cost(function(here), loss)
    done = least_squares(
        lambda y: function(y - offset), offset, lambda y: slope(y - offset), max_nfev=STEPS,
        xtol=1e-10, ftol=1e-9, gtol=1e-8, **settings,
    )  # fmt: skip
    state, _ = _state(start, arrow, free, done.x - offset)
    return state, 1 - float(done.cost) / max(before, 1e-300)


def _cost(whitened: Array, loss: str) -> float:
    """SciPy's cost of residuals under `linear` or `soft_l1` with its scale at 2."""
    square = whitened**2
    return float(square.sum() / 2 if loss == "linear" else 4 * (np.sqrt(1 + square / 4) - 1).sum())


def default_free(state: State, warp: bool = False, lens: bool = True, rig: bool = False) -> Array:
    """Which of the shared parameters are unknown: the cameras' (`lens`), their places (`rig`), the board's shape (`warp`)."""
    *cameras, places, shape = state.counts
    return np.concatenate([np.full(sum(cameras), lens), np.full(places, rig), np.full(shape, warp)])


def _state(start: State, arrow: Arrow, free: Array, y: Array) -> tuple[State, Moved]:
    motions, some = arrow.apply(y)
    shared = np.zeros(len(free))
    shared[free] = some
    places = np.split(shared, np.cumsum(start.counts)[:-1])[-2]
    return start.moved(motions, shared), Moved(motions, places.reshape(-1, 6))


def _problem(
    start: State, corners: Corners3, weight: Array, free: Array, arrow: Arrow
) -> tuple[Callable[[Array], Array], Callable[[Array], Any]]:
    """Residuals (2 N + B,) with those of B beliefs and their sparse slopes in the coordinates of `arrow`; both of one evaluation."""
    firm = start.belief[1]
    held = np.flatnonzero(free & (firm > 0))
    beliefs = np.zeros((len(held), 6 * len(start.poses) + int(free.sum())))
    beliefs[:, 6 * len(start.poses) :] = (firm[held, None] * np.eye(len(free))[held])[:, free] @ arrow.rim
    count, frames, shared = len(corners), len(start.poses), int(free.sum())
    columns = np.concatenate([
        np.repeat(6 * corners.frame[:, None] + np.arange(6), 2, axis=0).reshape(count, 2, 6),
        np.broadcast_to(6 * frames + np.arange(shared), (count, 2, shared)),
    ], axis=2)  # fmt: skip
    starts = np.arange(0, 2 * count * (6 + shared) + 1, 6 + shared)
    seen: dict[bytes, tuple[Array, Any]] = {}

    def evaluate(y: Array) -> tuple[Array, Any]:
        key = y.tobytes()
        if key not in seen:
            state, moved = _state(start, arrow, free, y)
            xy, by_frame, by_shared = linearise(state, corners, moved)
            gap = (xy - corners.xy) * weight[:, None]
            blind = ~np.isfinite(gap).all(axis=1)
            own, rim = arrow.slopes(by_frame, by_shared[:, :, free], corners.frame)
            values = np.concatenate([own, rim], axis=2) * weight[:, None, None]
            gap[blind], values[blind] = BEHIND, 0.0
            seen.clear()
            slopes = csr_array((values.ravel(), columns.ravel(), starts), shape=(2 * count, 6 * frames + shared))
            if len(held):
                slopes = vstack([slopes, beliefs], format="csr")
            seen[key] = np.append(gap.ravel(), (state.belief[0] * firm)[held]), slopes
        return seen[key]

    return lambda y: evaluate(y)[0], lambda y: evaluate(y)[1]
