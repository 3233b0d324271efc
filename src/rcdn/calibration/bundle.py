"""The bundle adjustment's unknowns (cameras and how late they are, poses, the board's shape), its residuals and their
analytic derivatives."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from rcdn.calibration.bending import Bending
from rcdn.calibration.motions import by_motion, moved, slopes_before, transformed
from rcdn.geometry import cross_matrix, project, project_with_jacobian
from rcdn.types import LENS, Array, Camera
from rcdn.types.arrays import Real

DENOMINATOR = 1.0
"""prior standard deviation of k4, k5 and k6 of a rational lens: numerator and denominator can share a factor that no
picture determines"""
RADIAL, TANGENTIAL = 1.0, 0.1
"""prior standard deviations of the other coefficients of a lens: those of real lenses are several times smaller, and a
coefficient that the corners do not determine stays 0"""

Rows = slice | Array
"""Numbers of corners: a slice where they follow each other, so that arrays of them are views"""


@dataclass(frozen=True, eq=False)
class Corners3:
    """N corners: `frame` (N,) number of the board's pose and `camera` (N,) number of the camera, among those of the
    state, that saw it; `board` (N, 2) on the nominal board, m; `xy` (N, 2) px; `basis` (N, B) values of the functions
    of the board's shape at each corner (B may be 0: a perfect plane); `part` (N,) number of its board among those fixed
    to each other (None: all are of one board)."""

    frame: Array
    camera: Array
    board: Array
    xy: Array
    basis: Array
    part: Array | None = None

    def __len__(self) -> int:
        return len(self.xy)

    def take(self, index: Rows) -> Corners3:
        """The corners at `index`; frame numbers are unchanged."""
        part = None if self.part is None else self.part[index]
        return Corners3(
            self.frame[index], self.camera[index], self.board[index], self.xy[index], self.basis[index], part
        )

    @cached_property
    def rows(self) -> dict[int, Rows]:
        """Of each camera that saw corners, their numbers."""
        out: dict[int, Rows] = {}
        for camera in np.unique(self.camera).tolist():
            of = np.flatnonzero(self.camera == camera)
            out[camera] = slice(int(of[0]), int(of[-1]) + 1) if of[-1] - of[0] + 1 == len(of) else of
        return out

    @cached_property
    def seen_by(self) -> dict[int, Corners3]:
        """Of each camera that saw corners, these."""
        return {camera: self.take(rows) for camera, rows in self.rows.items()}


@dataclass(frozen=True, eq=False)
class Prior:
    """A Gaussian prior of the K shared parameters: `mean` (K,) and `precision` (K, K), the inverse of its covariance
    (0: uninformative)."""

    mean: Array
    precision: Array

    def cost(self, values: Real[Array, " k"]) -> float:
        """Twice the negative logarithm of its density at `values` (K,), up to a constant."""
        off = values - self.mean
        return float(off @ self.precision @ off)

    def gradient(self, values: Array) -> Real[Array, " k"]:
        """(K,) half the derivative of `cost`."""
        return np.asarray(self.precision @ (values - self.mean))


@dataclass(frozen=True, eq=False)
class State:
    """All unknowns: `cameras`; `poses` (F, 4, 4) of the boards in the first camera; `rig` (C, 4, 4) takes the first
    camera's coordinates to those of each camera (the first: identity); `shape` (B, 3) m: displacement of a corner along
    the board's x, y and normal for each function of the corners' basis. `prior` of the shared parameters (default: that
    of the lens models). `boards` (B, 4, 4): of boards fixed to each other, takes each one's coordinates to those of the
    first (the first: identity), whose poses are the frames'. `smooth`: for each camera the variance of the control
    points of its smooth correction in the default prior, 0 without one (default: none has any). `late` (C,): by how
    many moments each camera takes its pictures after the moments of the `poses`; it sees a corner that is at x in the
    first camera at x + late (ω × x + v), where (ω, v) is the row of `velocity` (F, 6) of its frame, rad and m a moment
    (default: none is late)."""

    cameras: tuple[Camera, ...]
    poses: Array
    rig: Array
    shape: Array = field(default_factory=lambda: np.zeros((0, 3)))
    prior: Prior | None = None
    boards: Array = field(default_factory=lambda: np.eye(4)[None])
    smooth: tuple[float, ...] = ()
    late: Array = field(default_factory=lambda: np.zeros(0))
    velocity: Array = field(default_factory=lambda: np.zeros((0, 6)))

    @classmethod
    def mono(cls, camera: Camera, poses: Array, shape: Array | None = None, boards: Array | None = None) -> State:
        """The state of one camera."""
        state = cls((camera,), poses, np.eye(4)[None], np.zeros((0, 3)) if shape is None else shape)
        return state if boards is None else replace(state, boards=boards)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of shared parameters of each camera, of the places (of the other cameras, then of the other boards),
        of the cameras' lateness, and of the shape."""
        places = 6 * (len(self.cameras) + len(self.boards) - 2)
        return (*(len(c.parameters) for c in self.cameras), places, self.late.size, self.shape.size)

    @property
    def lateness(self) -> slice:
        """The cameras' lateness among the shared parameters."""
        end = sum(self.counts[:-1])
        return slice(end - self.late.size, end)

    @cached_property
    def values(self) -> Real[Array, " k"]:
        """(K,) the shared parameters; places are small motions from the current ones, thus 0."""
        places = np.zeros(self.counts[-3])
        out = np.concatenate([*(c.parameters for c in self.cameras), places, self.late, self.shape.ravel()])
        out.setflags(write=False)
        return out

    @property
    def beforehand(self) -> Prior:
        """The `prior`, by default that of the lens models."""
        return lens_prior(self) if self.prior is None else self.prior

    def with_velocity(self, velocity: Real[Array, "f 6"]) -> State:
        """The state with no camera late yet, in which boards move by `velocity` (F, 6) in a moment; no prior holds the
        cameras' lateness."""
        zeros, at, prior = np.zeros(len(self.cameras)), self.lateness.start, self.prior
        if prior is not None and not len(self.late):
            where = np.full(len(zeros), at)
            precision = np.insert(np.insert(prior.precision, where, 0.0, axis=0), where, 0.0, axis=1)
            prior = Prior(np.insert(prior.mean, where, 0.0), precision)
        return replace(self, late=zeros, velocity=velocity, prior=prior)

    def moved(self, by_frame: Real[Array, "f 6"], shared: Real[Array, " k"]) -> State:
        """The state after small motions `by_frame` (F, 6) of the poses and the change `shared` (K,) of the shared
        parameters."""
        ends, others = list(accumulate(self.counts)), len(self.cameras) - 1
        *lenses, places, late, shape = (shared[a:b] for a, b in pairwise([0, *ends]))
        cameras = tuple(c.with_parameters(c.parameters + d) for c, d in zip(self.cameras, lenses, strict=True))
        rig, boards, motions = self.rig, self.boards, places.reshape(-1, 6)
        if len(motions):
            rig, boards = rig.copy(), boards.copy()
            rig[1:], boards[1:] = moved(rig[1:], motions[:others]), moved(boards[1:], motions[others:])
        poses, shape = moved(self.poses, by_frame), self.shape + shape.reshape(-1, 3)
        return replace(self, cameras=cameras, poses=poses, rig=rig, shape=shape, boards=boards, late=self.late + late)


FIRM = 1e10
"""1 / px², prior precision of what is held fixed: a standard deviation of 0.01 thousandths of a pixel"""


def lens_prior(state: State) -> Prior:
    """The prior of the lenses: their coefficients are small, and smooth corrections bend little. Without it a
    polynomial that no corner constrains could fold where no corner was seen."""
    precision, at, bent = np.zeros(sum(state.counts)), 0, dict[int, Array]()
    for camera, variance in zip(state.cameras, state.smooth or (0.0,) * len(state.cameras), strict=True):
        for k, name in enumerate(LENS[camera.model][: len(camera.distortion)]):
            denominator = name in ("k4", "k5", "k6") and camera.model == "rational"
            spread = DENOMINATOR if denominator else TANGENTIAL if name.startswith("p") else RADIAL
            precision[at + 4 + k] = 1 / spread**2
        if variance:
            bent[at + camera.coefficients] = Bending.of(camera).energy / variance
        at += len(camera.parameters)
    whole = np.diag(precision)
    for first, energy in bent.items():
        whole[first : first + len(energy), first : first + len(energy)] = energy
    return Prior(np.zeros(len(precision)), whole)


def with_fixed(state: State, fixed: Collection[str]) -> State:
    """`state` of one camera whose `aspect` (fx = fy) or `principal_point` (centre of the picture) is held `fixed` by a
    prior that outweighs any corners."""
    if not fixed:
        return state
    (camera,), prior = state.cameras, lens_prior(state)
    mean, precision, K = prior.mean.copy(), prior.precision.copy(), camera.K.copy()
    if "aspect" in fixed:
        K[0, 0] = K[1, 1] = (K[0, 0] + K[1, 1]) / 2
        precision[:2, :2] += FIRM * np.array([[1.0, -1.0], [-1.0, 1.0]])
    if "principal_point" in fixed:
        K[:2, 2] = mean[2:4] = (np.array(camera.image_size) - 1) / 2
        precision[[2, 3], [2, 3]] += FIRM
    return replace(state, cameras=(replace(camera, K=K),), prior=Prior(mean, precision))


def residuals(state: State, corners: Corners3) -> Real[Array, "n 2"]:
    """(N, 2) observed − projected, px; NaN where the camera cannot see the corner."""
    points, xy = _placed(state, corners)[2], np.full((len(corners), 2), np.nan)
    if len(state.cameras) == 1:
        return np.asarray(corners.xy - project(state.cameras[0], points))
    for c, of in corners.rows.items():
        xy[of] = project(state.cameras[c], points[of])
    return np.asarray(corners.xy - xy)


def on_first_board(state: State, corners: Corners3) -> Real[Array, "n 3"]:
    """(N, 3) m: the corners in the coordinates of the first of the boards that are fixed to each other, including the
    boards' shape."""
    board = corners.basis[:, : len(state.shape)] @ state.shape
    board[:, :2] += corners.board
    if corners.part is None or len(state.boards) == 1:
        return board
    return transformed(state.boards, corners.part, board)


def middles(state: State, corners: Corners3) -> Real[Array, "f 3"]:
    """(F, 3) m: mean nominal position of each frame's corners, in the coordinates of the first board; zero without
    corners."""
    points, frames = on_first_board(replace(state, shape=np.zeros((0, 3))), corners), len(state.poses)
    sums = np.stack([np.bincount(corners.frame, points[:, i], frames) for i in range(3)], axis=1)
    return np.asarray(sums / np.maximum(np.bincount(corners.frame, minlength=frames), 1)[:, None])


def _placed(state: State, corners: Corners3) -> tuple[Array, Array, Array]:
    """(N, 3) the corners in the coordinates of the first board, in those of the first camera, and, when the camera that
    saw each took its picture, in that one's."""
    board = on_first_board(state, corners)
    first = transformed(state.poses, corners.frame, board)
    then = first
    if len(state.late):
        then = first + state.late[corners.camera][:, None] * _carried(state, corners, first)
    return board, first, then if (state.rig == np.eye(4)).all() else transformed(state.rig, corners.camera, then)


def _carried(state: State, corners: Corners3, first: Real[Array, "n 3"]) -> Real[Array, "n 3"]:
    """(N, 3) m: the corners' displacements in a moment, at `first` in the first camera's coordinates."""
    motion = state.velocity[corners.frame]
    return np.asarray(np.cross(motion[:, :3], first) + motion[:, 3:])


def linearise(state: State, corners: Corners3) -> tuple[Array, Array, Array]:
    """Projections (N, 2), px, and their Jacobians with respect to the frames' motions (N, 2, 6) and to the shared
    parameters (N, 2, K)."""
    if len(state.cameras) == 1:
        return linearise_one(state, corners, 0)
    xy, by_frame = np.full((len(corners), 2), np.nan), np.zeros((len(corners), 2, 6))
    shared = np.zeros((len(corners), 2, sum(state.counts)))
    for c, mine in corners.seen_by.items():
        of = np.arange(len(corners))[corners.rows[c]]
        xy[of], by_frame[of], own = linearise_one(state, mine, c)
        shared[of[:, None, None], np.arange(2)[:, None], np.flatnonzero(parameters_of(state, c))] = own
    return xy, by_frame, shared


def parameters_of(state: State, camera: int) -> Array:
    """(K,) bool: the shared parameters on which one camera's corners depend: its lens, its place, the boards' places,
    its lateness, and the boards' shape."""
    lenses, others = state.counts[:-3], 6 * (len(state.cameras) - 1)
    out = np.zeros(sum(state.counts), bool)
    at = sum(lenses[:camera])
    out[at : at + lenses[camera]] = True
    if camera:
        at = sum(lenses) + 6 * (camera - 1)
        out[at : at + 6] = True
    out[sum(lenses) + others :] = True
    if len(state.late):
        out[state.lateness] = np.arange(len(state.late)) == camera
    return out


def linearise_one(state: State, corners: Corners3, camera: int) -> tuple[Array, Array, Array]:
    """As `linearise`, for corners of one camera: with respect to its `parameters_of` only."""
    board, first, points = _placed(state, corners)
    xy, by_point, by_lens = project_with_jacobian(state.cameras[camera], points)
    R = state.rig[camera, :3, :3]
    in_first = by_point if (np.eye(3) == R).all() else (by_point.reshape(-1, 3) @ R).reshape(by_point.shape)
    by_late = list[Array]()
    if len(state.late):
        by_late.append(in_first @ _carried(state, corners, first)[:, :, None])
        in_first = in_first @ (np.eye(3) + cross_matrix(state.late[camera] * state.velocity[corners.frame, :3]))
    part = corners.part if len(state.boards) > 1 else None
    parts, by_shape = [by_lens], list[Array]()
    if camera:
        parts.append(by_motion(by_point, points))
    if part is not None or len(state.shape):
        by_board = slopes_before(state.poses, corners.frame, in_first)
        if part is not None:
            parts.append(_by_places(part, len(state.boards), by_motion(by_board, board)))
            by_board = slopes_before(state.boards, part, by_board)
        if len(state.shape):
            by_shape = [_by_shape(corners.basis[:, : len(state.shape)], by_board)]
    parts += [*by_late, *by_shape]
    shared = np.concatenate(parts, axis=2) if len(parts) > 1 else by_lens
    return xy, by_motion(in_first, first), shared


def _by_shape(functions: Real[Array, "n b"], by_board: Real[Array, "n 2 3"]) -> Real[Array, "n 2 k"]:
    """(N, 2, 3 B) derivatives by the shape's coefficients, of those `by_board` by the corners' places."""
    out = np.empty((*by_board.shape[:2], functions.shape[1], 3))
    for axis in range(3):
        np.multiply(functions[:, None], by_board[:, :, axis, None], out=out[:, :, :, axis])
    return out.reshape(*out.shape[:2], 3 * functions.shape[1])


def _by_places(part: Array, boards: int, by_motion: Real[Array, "n 2 6"]) -> Real[Array, "n 2 k"]:
    """(N, 2, 6 (B − 1)) derivatives by the places of all boards but the first, of those `by_motion` (N, 2, 6) of each
    corner's own board, number `part` (N,)."""
    out = np.zeros((len(part), 2, boards, 6))
    out[np.arange(len(part)), :, part] = by_motion
    return out[:, :, 1:].reshape(len(part), 2, 6 * (boards - 1))


def default_free(state: State, shape: bool = False, lens: bool = True, rig: bool = False) -> Array:
    """(K,) bool, which shared parameters are unknown: those of the cameras (`lens`), the places of the other cameras
    and boards (`rig`), the board's `shape`; never the cameras' lateness."""
    *cameras, places, late, bends = state.counts
    return np.concatenate(
        [np.full(sum(cameras), lens), np.full(places, rig), np.full(late, False), np.full(bends, shape)]
    )
