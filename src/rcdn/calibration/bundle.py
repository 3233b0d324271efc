"""The bundle adjustment's unknowns (cameras, poses, the board's shape), its residuals and their analytic
derivatives."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rcdn.geometry import cross_matrix, project, project_with_jacobian, rotation
from rcdn.types import LENS, Array, Camera
from rcdn.types.arrays import Real

DENOMINATOR = 1.0
"""prior standard deviation of k4, k5 and k6 of a rational lens: numerator and denominator can share a factor that no
picture determines"""
RADIAL, TANGENTIAL = 1.0, 0.1
"""prior standard deviations of the other coefficients of a lens: those of real lenses are several times smaller, and a
coefficient that the corners do not determine stays 0"""


@dataclass(frozen=True, eq=False)
class Corners3:
    """N corners: `frame` (N,) number of the board's pose and `camera` (N,) number of the camera that saw it; `board`
    (N, 2) on the nominal board, m; `xy` (N, 2) px; `basis` (N, B) values of the functions of the board's shape at each
    corner (B may be 0: a perfect plane)."""

    frame: Array
    camera: Array
    board: Array
    xy: Array
    basis: Array

    def __len__(self) -> int:
        return len(self.xy)

    def take(self, index: Any) -> Corners3:
        """The corners at `index`; frame numbers are unchanged."""
        return Corners3(self.frame[index], self.camera[index], self.board[index], self.xy[index], self.basis[index])


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
    of the lens models)."""

    cameras: tuple[Camera, ...]
    poses: Array
    rig: Array
    shape: Array = field(default_factory=lambda: np.zeros((0, 3)))
    prior: Prior | None = None

    @classmethod
    def mono(cls, camera: Camera, poses: Array, shape: Array | None = None) -> State:
        """The state of one camera."""
        return cls((camera,), poses, np.eye(4)[None], np.zeros((0, 3)) if shape is None else shape)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of shared parameters of each camera, of the rig, and of the shape."""
        return (*(len(c.parameters) for c in self.cameras), 6 * (len(self.cameras) - 1), self.shape.size)

    @property
    def values(self) -> Real[Array, " k"]:
        """(K,) the shared parameters; those of the rig are small motions from its current poses, thus 0."""
        places = np.zeros(self.counts[-2])
        return np.concatenate([*(c.parameters for c in self.cameras), places, self.shape.ravel()])

    @property
    def beforehand(self) -> Prior:
        """The `prior`, by default that of the lens models."""
        return lens_prior(self) if self.prior is None else self.prior

    def moved(self, by_frame: Real[Array, "f 6"], shared: Real[Array, " k"]) -> State:
        """The state after small motions `by_frame` (F, 6) of the poses and the change `shared` (K,) of the shared
        parameters."""
        *lenses, places, shape = np.split(shared, np.cumsum(self.counts)[:-1])
        cameras = tuple(c.with_parameters(c.parameters + d) for c, d in zip(self.cameras, lenses, strict=True))
        rig = self.rig.copy()
        rig[1:] = _move(rig[1:], places.reshape(-1, 6))
        return replace(
            self, cameras=cameras, poses=_move(self.poses, by_frame), rig=rig, shape=self.shape + shape.reshape(-1, 3)
        )


FIRM = 1e10
"""1 / px², prior precision of what is held fixed: a standard deviation of 0.01 thousandths of a pixel"""


def lens_prior(state: State) -> Prior:
    """The prior of the lenses: their coefficients are small. Without it a polynomial that no corner constrains could
    fold where no corner was seen."""
    precision, at = np.zeros(sum(state.counts)), 0
    for camera in state.cameras:
        for k, name in enumerate(LENS[camera.model][: len(camera.distortion)]):
            denominator = name in ("k4", "k5", "k6") and camera.model == "rational"
            spread = DENOMINATOR if denominator else TANGENTIAL if name.startswith("p") else RADIAL
            precision[at + 4 + k] = 1 / spread**2
        at += len(camera.parameters)
    return Prior(np.zeros(len(precision)), np.diag(precision))


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


def _move(T: Array, motions: Array) -> Real[Array, "f 4 4"]:
    """Poses (F, 4, 4) after motions (F, 6): a rotation about the origin of the camera, then a translation."""
    out, R = T.copy(), rotation(motions[:, :3])
    out[:, :3, :3] = R @ T[:, :3, :3]
    out[:, :3, 3] = (R @ T[:, :3, 3, None])[..., 0] + motions[:, 3:]
    return out


def residuals(state: State, corners: Corners3) -> Real[Array, "n 2"]:
    """(N, 2) observed − projected, px; NaN where the camera cannot see the corner."""
    points, xy = _placed(state, corners)[1], np.full((len(corners), 2), np.nan)
    for c, camera in enumerate(state.cameras):
        of = np.flatnonzero(corners.camera == c)
        xy[of] = project(camera, points[of])
    return np.asarray(corners.xy - xy)


def _placed(state: State, corners: Corners3) -> tuple[Array, Array]:
    """(N, 3) the corners in the first camera's coordinates, and in those of the camera that saw each."""
    shape = corners.basis[:, : len(state.shape)] @ state.shape
    board = np.column_stack([corners.board, np.zeros(len(corners))]) + shape
    T, rig = state.poses[corners.frame], state.rig[corners.camera]
    first = (T[:, :3, :3] @ board[:, :, None])[..., 0] + T[:, :3, 3]
    return first, (rig[:, :3, :3] @ first[:, :, None])[..., 0] + rig[:, :3, 3]


def linearise(state: State, corners: Corners3) -> tuple[Array, Array, Array]:
    """Projections (N, 2), px, and their Jacobians with respect to the frames' motions (N, 2, 6) and to the shared
    parameters (N, 2, K)."""
    T, cam, offsets = state.poses[corners.frame], corners.camera, np.cumsum([0, *state.counts])
    first, points = _placed(state, corners)
    by_motion = motion_jacobian(first)
    xy, by_frame = np.full((len(corners), 2), np.nan), np.zeros((len(corners), 2, 6))
    shared = np.zeros((len(corners), 2, offsets[-1]))
    for c, camera in enumerate(state.cameras):
        of = np.flatnonzero(cam == c)
        xy[of], by_point, shared[of, :, offsets[c] : offsets[c + 1]] = project_with_jacobian(camera, points[of])
        in_first = by_point @ state.rig[c, :3, :3]
        by_frame[of] = in_first @ by_motion[of]
        if c:
            at = offsets[-3] + 6 * (c - 1)
            shared[of, :, at : at + 6] = by_point @ motion_jacobian(points[of])
        if len(state.shape):
            by_board = in_first @ T[of, :3, :3]
            functions = corners.basis[of, : len(state.shape)]
            shared[of, :, offsets[-2] :] = (functions[:, None, :, None] * by_board[:, :, None, :]).reshape(
                len(of), 2, state.shape.size
            )
    return xy, by_frame, shared


def motion_jacobian(points: Real[Array, "n 3"]) -> Real[Array, "n 3 6"]:
    """∂point/∂motion (N, 3, 6) of `points` (N, 3)."""
    out = np.zeros((len(points), 3, 6))
    out[:, :, :3] = -cross_matrix(points)
    out[:, [0, 1, 2], [3, 4, 5]] = 1.0
    return out


def default_free(state: State, shape: bool = False, lens: bool = True, rig: bool = False) -> Array:
    """(K,) bool, which shared parameters are unknown: those of the cameras (`lens`), their relative poses (`rig`), the
    board's `shape`."""
    *cameras, places, bends = state.counts
    return np.concatenate([np.full(sum(cameras), lens), np.full(places, rig), np.full(bends, shape)])
