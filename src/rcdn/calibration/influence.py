"""The contribution of each view to the camera: its score and information, with its own pose eliminated.

At the solution the residuals of view v are linear in small changes of its pose and of the camera's parameters.
Eliminating the pose by a QR factorisation leaves a score g_v (P,) and an information matrix S_v (P, P); the
Gauss–Newton step of the camera for a set of views is (Σ S_v + prior)⁻¹ Σ g_v. The errors of the corners of one view are
correlated (bent paper, an imperfect lens model), so that the uncertainty of such a step is estimated from the scatter
between views, by a jackknife that leaves out one view at a time; the noise of single corners would underestimate it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.board_points import flat_points, has_shape
from rcdn.calibration.bundle import Corners3, State, linearise
from rcdn.calibration.shape import KNOWN, on_shape
from rcdn.calibration.smooth_lens import variance_of
from rcdn.calibration.solver import without_pose
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Bool, Real

RIDGE = 1e-10
"""added to a normal matrix with unit diagonal"""
LEAST_SCATTER = 1e-6
"""px along one axis: least standard deviation of a corner, used if both the sigma and the noise are smaller"""
FIRM = 1e6
"""× the information on a parameter: large enough to hold it fixed"""
HELD = 1e-3
"""px: a principal point of smaller standard deviations was held fixed, by a prior"""


@dataclass(frozen=True, eq=False)
class ViewInformation:
    """For V views and P camera parameters: `score` (V, P), `information` (V, P, P), and the `prior` (P, P)
    information."""

    score: Array
    information: Array
    prior: Array

    def __len__(self) -> int:
        return len(self.score)

    def at_optimum(self) -> ViewInformation:
        """The same views, linearised after one Gauss–Newton step, where the sum of their scores is zero up to the
        prior."""
        step = solved(self.information.sum(axis=0) + self.prior, self.score.sum(axis=0))
        return ViewInformation(self.score - self.information @ step, self.information, self.prior)


def corners_of(calibration: Calibration, views: Sequence[BoardView], masks: Sequence[Array]) -> tuple[Corners3, Array]:
    """The corners of `views` at their `masks` (M,) bool, frame k being view k, and their sigma (N,) px, 0 where
    unknown."""
    ij, xy, sigma = (
        np.concatenate([getattr(v, name)[m] for v, m in zip(views, masks, strict=True)])
        for name in ("ij", "xy", "sigma")
    )
    frame = np.repeat(np.arange(len(views)), [int(m.sum()) for m in masks])
    known = np.repeat([has_shape(calibration, v) for v in views], [int(m.sum()) for m in masks])
    board = np.concatenate([flat_points(calibration, v)[m] for v, m in zip(views, masks, strict=True)])
    basis = np.zeros((len(ij), 1))
    board[known], basis[known] = on_shape(board[known], ij[known], calibration.shape)
    return Corners3(frame, np.zeros(len(frame), int), board, xy, basis), np.nan_to_num(sigma)


def state_of(calibration: Calibration, views: Sequence[BoardView]) -> State:
    """The camera and the poses of `views`, all of which have one."""
    poses = np.stack([v.pose.T_cam_board for v in views if v.pose is not None])
    return replace(State.mono(calibration.camera, poses, KNOWN), smooth=(variance_of(calibration),))


def view_information(calibration: Calibration) -> ViewInformation:
    """The contribution of each of `calibration.used_views` to the camera's parameters."""
    views = calibration.used_views
    corners, sigma = corners_of(calibration, views, [v.used for v in views])
    info = of_state(
        state_of(calibration, views),
        corners,
        1 / np.sqrt(np.maximum(calibration.noise**2 + sigma**2, LEAST_SCATTER**2)),
    )
    return ViewInformation(info.score, info.information, info.prior + _fixed(calibration, info))


def held_fixed(calibration: Calibration) -> frozenset[str]:
    """What the calibration held fixed: `principal_point`, if it is `HELD`, and `aspect`, if fx and fy are equal and
    fully correlated."""
    cov, camera = calibration.cov, calibration.camera
    (fx, fy), (a, b) = camera.parameters[:2], np.sqrt(np.diag(cov)[:2])
    names = {
        "aspect": fx == fy and a > 0 and cov[0, 1] > (1 - 1e-9) * a * b,
        "principal_point": bool((np.diag(cov)[2:4] <= HELD**2).all()),
    }
    return frozenset(name for name, held in names.items() if held)


def _fixed(calibration: Calibration, info: ViewInformation) -> Real[Array, "p p"]:
    """(P, P) prior information on what the calibration held fixed."""
    diagonal, held = np.diag(info.information.sum(axis=0)), held_fixed(calibration)
    fixed = np.diag(calibration.cov)[:-6] <= 0
    fixed[2:4] |= "principal_point" in held
    out = np.diag(np.where(fixed, FIRM * diagonal, 0.0))
    if "aspect" in held:
        out[:2, :2] += FIRM * diagonal[:2].max() * np.array([[1, -1], [-1, 1]])
    return out


def of_state(state: State, corners: Corners3, weight: Real[Array, " n"]) -> ViewInformation:
    """The same for a `state` of one camera: each frame is a view, its corners with `weight` (N,) 1 / px (0: left
    out)."""
    many = len(state.cameras[0].parameters)
    xy, by_pose, by_shared = linearise(state, corners)
    gaps = np.nan_to_num(corners.xy - xy) * weight[:, None]
    by_pose = np.nan_to_num(by_pose) * weight[:, None, None]
    by_camera = np.nan_to_num(by_shared[:, :, :many]) * weight[:, None, None]
    scores, information = [], []
    for f in range(len(state.poses)):
        mine = corners.frame == f
        J, r = without_pose(by_pose[mine], by_camera[mine], gaps[mine])
        scores.append(J.T @ r)
        information.append(J.T @ J)
    prior = state.beforehand.precision[:many, :many]
    return ViewInformation(np.array(scores), np.array(information), prior)


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference `value` (n, q) between the groups of n splits along q directions, its standard deviation `std` (n,
    q) and degrees of freedom `freedom` (n, q)."""

    value: Array
    std: Array
    freedom: Array


def group_difference(info: ViewInformation, directions: Real[Array, "p q"], splits: Array) -> Difference:
    """The difference of the views of `splits` (n, V) bool from the others along `directions` (P, q); the other
    parameters of the camera are common to both.

    Standard deviations are those of a jackknife over views, with separate contributions of the groups; degrees of
    freedom after Welch (1947) and Satterthwaite.
    """
    inside = np.asarray(splits, float)
    every, without = _joint(info, directions, inside, None), []
    for v in range(len(info)):
        without.append(_joint(info, directions, inside, v) - every)
    square = np.array(without) ** 2
    counts = np.stack([(1 - inside).sum(axis=1), inside.sum(axis=1)])
    shares = np.stack([np.einsum("vnq,nv->nq", square, side) for side in (1 - inside, inside)])
    shares *= ((counts - 1) / counts)[:, :, None]
    variance = shares.sum(axis=0)
    freedom = variance**2 / np.maximum((shares**2 / (counts - 1)[:, :, None]).sum(axis=0), 1e-300)
    return Difference(every, np.sqrt(variance), freedom)


def _joint(info: ViewInformation, directions: Array, inside: Array, without: int | None) -> Real[Array, "n q"]:
    """(n, q) least-squares change along `directions` of the views inside, together with a common change of all;
    `without` one view."""
    keep = np.ones(len(info))
    if without is not None:
        keep[without] = 0.0
    mine = inside * keep
    S, g = info.information, info.score
    count, many = len(inside), directions.shape[0]
    size = many + directions.shape[1]
    H = np.zeros((count, size, size))
    H[:, :many, :many] = np.tensordot(keep, S, 1) + info.prior
    part = np.tensordot(mine, S, 1) @ directions
    H[:, :many, many:], H[:, many:, :many] = part, part.transpose(0, 2, 1)
    H[:, many:, many:] = directions.T @ part
    right = np.concatenate([np.broadcast_to(keep @ g, (count, many)), mine @ g @ directions], axis=1)
    return solved(H, right)[:, many:]


def gains(info: ViewInformation, splits: Bool[Array, "n v"]) -> Real[Array, " n"]:
    """(n,) decrease of the sum of whitened squares if the views of each of `splits` (n, V) get a camera of their own,
    with all its parameters.

    `info` is linearised at its optimum (`at_optimum`).
    """
    inside = np.asarray(splits, float)
    H = info.information.sum(axis=0) + info.prior
    part = np.tensordot(inside, info.information, 1)
    score = inside @ info.score
    return np.einsum("np,np->n", score, solved(part - part @ _solve_all(H, part), score))


def solved(H: Real[Array, "... n n"], right: Real[Array, "... n"]) -> Real[Array, "... n"]:
    """Solutions (..., n) of symmetric `H` (..., n, n) for `right` (..., n); scaled, with a small ridge."""
    return _solve_all(H, right[..., None])[..., 0]


def _solve_all(H: Array, right: Array) -> Real[Array, "... n m"]:
    """The same for several right-hand sides (..., n, m)."""
    scale = 1 / np.sqrt(np.maximum(np.einsum("...ii->...i", H), 1e-300))
    scaled = H * scale[..., :, None] * scale[..., None, :] + RIDGE * np.eye(H.shape[-1])
    return np.asarray(scale[..., :, None] * np.linalg.solve(scaled, scale[..., :, None] * right))
