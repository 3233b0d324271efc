"""Time shifts between cameras: estimated from moving boards, and corrected by moving corners to the nominal moments of
their images.

A camera that is late by τ sees a board at its position τ after the nominal moment, along its path. Each camera's own
view of a board therefore differs from the mean of all cameras at that moment by (τ − mean τ) × the board's velocity,
which is linear in all τ at once. For the correction, the path between moments is interpolated by a parabola through
three of them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration import robust
from rcdn.calibration.bundle import Corners3, State, default_free, middles, residuals
from rcdn.calibration.rig_fit import refitted
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.solver import solve
from rcdn.geometry import cross_matrix
from rcdn.types import Array, TimeShift

STAMPS = 1000
"""median difference of the moments' numbers above which they are time stamps, not frames: the unit is then that
difference"""
FEWEST_MOVES = 6
"""fewest moments with a moving board for the estimate of a time shift"""
STILL = 1e-3
"""least displacement of a board between moments to count as moving, share of its distance"""
NEAR = 2.0
"""× the median time between moments: neighbours farther apart give no velocity"""
FAR = 1e3
"""px, sigma that removes corners from the fit"""
ROUNDS, CONVERGED = 5, 0.005
"""largest number of rounds of correction and fit; largest change, in moments, at which they end"""


def times_of(moments: Iterable[str]) -> dict[str, float]:
    """The time of each moment.

    That is its trailing number if all end in different ones (unit: one frame, or, for time stamps, their median
    difference), else its rank.
    """
    names = list(dict.fromkeys(moments))
    found = [re.search(r"(\d+)\D*$", name) for name in names]
    numbers = [int(match[1]) for match in found if match is not None]
    if len(numbers) == len(names) and len(set(numbers)) == len(names):
        typical = float(np.median(np.diff(np.unique(numbers)))) if len(numbers) > 1 else 1.0
        unit = typical if typical > STAMPS else 1.0
        return {name: n / unit for name, n in zip(names, numbers, strict=True)}
    return {name: float(k) for k, name in enumerate(sorted(names))}


@dataclass(frozen=True, eq=False)
class Path:
    """Path of the boards over time: `frame`s of the joint problem in the order of their `time` (F,), each target's
    contiguous; poses `T` (F, 4, 4) and the `middle` (F, 3) of each board on it; `near` (F,) bool: whether both
    neighbours are of the same target and close in time."""

    frame: Array
    time: Array
    T: Array
    middle: Array
    near: Array

    @classmethod
    def of(cls, task: RigTask, state: State, time: Mapping[str, float]) -> Path:
        """The path of all boards shared by the cameras of `task`."""
        shared = [(key[1], time[key[0]], f) for f, key in enumerate(task.keys) if key is not None]
        target, when, frame = (
            (np.array(column) for column in zip(*sorted(shared), strict=True)) if shared else (np.zeros(0),) * 3
        )
        frame = frame.astype(int)
        middle = middles(state, task.corners)[frame]
        gap = np.where(np.diff(target) == 0, np.diff(when), np.inf)
        typical = float(np.median(gap[np.isfinite(gap)])) if np.isfinite(gap).any() else 0.0
        close = gap <= NEAR * typical
        near = np.concatenate([[False], close]) & np.concatenate([close, [False]]) if len(frame) else np.zeros(0, bool)
        return cls(frame, when, state.poses[frame], middle, near)

    @property
    def places(self) -> Array:
        """(F, 3) m: centres of the boards."""
        return (self.T[:, :3, :3] @ self.middle[:, :, None])[..., 0] + self.T[:, :3, 3]

    @property
    def velocity(self) -> Array:
        """(F, 3) m per moment: velocities of the boards' centres; NaN without close neighbours."""
        out, places = np.full((len(self.frame), 3), np.nan), self.places
        k = np.flatnonzero(self.near)
        out[k] = (places[k + 1] - places[k - 1]) / (self.time[k + 1] - self.time[k - 1])[:, None]
        return out

    def later(self, by: float) -> Array:
        """(F, 4, 4): the poses `by` moments after each one's own; NaN where the path is unknown there."""
        out, places = np.full((len(self.frame), 4, 4), np.nan), self.places
        middle = np.flatnonzero(self.near)
        for k in range(len(self.frame)):
            then = self.time[k] + by
            if not len(middle):
                break
            m = middle[np.argmin(np.abs(self.time[middle] - then) + 1e9 * (np.abs(middle - k) > abs(by) * 2 + 1))]
            if not self.time[m - 1] <= then <= self.time[m + 1]:
                continue
            t = self.time[m - 1 : m + 2] - self.time[m]
            turns = Rotation.from_matrix(self.T[m - 1 : m + 2, :3, :3] @ self.T[m, :3, :3].T).as_rotvec()
            share = _parabola(t, then - self.time[m])
            out[k] = np.eye(4)
            out[k, :3, :3] = Rotation.from_rotvec(share @ turns).as_matrix() @ self.T[m, :3, :3]
            out[k, :3, 3] = share @ places[m - 1 : m + 2] - out[k, :3, :3] @ self.middle[k]
        return out


def _parabola(t: Array, at: float) -> Array:
    """(3,) weights of the values at the times `t` (3,) in the value `at` a time of the parabola through them
    (Lagrange)."""
    return np.array([np.prod([(at - t[j]) / (t[i] - t[j]) for j in range(3) if j != i]) for i in range(3)])


def shifts_of(
    task: RigTask, fit: robust.Fit, path: Path, corners: Corners3, lags: Sequence[int], first: int | None = None
) -> dict[int, TimeShift]:
    """Time shift of each camera beyond its whole moments `lags`, by its number in `task`, relative to the camera
    `first`, whose shift is 0.

    `first`: None for the camera that agrees best with the others. `corners`: those of the task, or corrected ones. A
    camera's pose was estimated as if it had no shift, and absorbed a part of it: a small motion of each camera is
    therefore unknown, too. Least absolute residuals (reweighted); standard deviations from the residuals of whole
    moments. Cameras that saw fewer than FEWEST_MOVES moving boards together with others are left out.
    """
    v, speed = path.velocity, np.linalg.norm(path.velocity, axis=1)
    moving = speed > STILL * np.linalg.norm(path.places, axis=1)
    at = {f: k for k, f in enumerate(path.frame.tolist()) if moving[k]}
    seen: dict[int, dict[int, Array]] = {}
    for local in range(len(task.cameras)):
        for f, place in _own_places(fit, path, corners, local).items():
            if f in at:
                seen.setdefault(at[f], {})[local] = place
    points = path.places
    rows, misses, of, camera = [], [], [], []
    for k, places in seen.items():
        if len(places) < 2:
            continue
        mean = np.mean(list(places.values()), axis=0)
        share = np.zeros(len(task.cameras))
        share[list(places)] = 1 / len(places)
        for local, place in places.items():
            own = np.column_stack([v[k], -cross_matrix(points[k]), np.eye(3)])
            rows.append(np.kron(np.eye(len(share))[local] - share, own))
            misses.append(place - mean)
            of.append(k)
            camera.append(local)
    counts = np.bincount(np.array(camera, int), minlength=len(task.cameras))
    known = np.flatnonzero(counts >= FEWEST_MOVES)
    if len(known) < 2:
        return {}
    columns = (7 * known[:, None] + np.arange(7)).ravel()
    found, cov = _least_absolute(np.array(rows)[:, :, columns], np.array(misses), np.array(of))
    tau, cov = found[::7], cov[::7, ::7]
    late = tau + np.array(lags)[known]
    apart = np.abs(late[:, None] - late[None]).sum(axis=1)
    zero = int(np.argmin(apart.round(9))) if first is None else int(np.flatnonzero(known == first)[0])
    J = np.eye(len(known)) - np.eye(len(known))[zero]
    tau, std = J @ tau, np.sqrt(np.maximum(np.diag(J @ cov @ J.T), 0.0))
    return {int(c): TimeShift(float(t), float(s)) for c, t, s in zip(known, tau, std, strict=True)}


def _least_absolute(A: Array, d: Array, cluster: Array) -> tuple[Array, Array]:
    """x (n,) that minimises Σ |d − A x| for `A` (R, 3, n), `d` (R, 3), of least norm, and its covariance by clusters
    (R,)."""
    weight, x = np.ones(len(d)), np.zeros(A.shape[2])
    for _ in range(20):
        H = np.einsum("r,rik,ril->kl", weight, A, A)
        inverse = np.linalg.pinv(H, rcond=1e-9)
        x = inverse @ np.einsum("r,rik,ri->k", weight, A, d)
        gap = np.linalg.norm(d - A @ x, axis=1)
        weight = 1 / np.maximum(gap, 0.1 * np.median(gap) + 1e-12)
    score = np.einsum("r,rik,ri->rk", weight, A, d - A @ x)
    number = np.unique(cluster, return_inverse=True)[1]
    sums = np.stack([np.bincount(number, column) for column in score.T], axis=1)
    return x, inverse @ sums.T @ sums @ inverse


def _own_places(fit: robust.Fit, path: Path, corners: Corners3, local: int) -> dict[int, Array]:
    """By frame, (3,) m in the rig's frame: the centre of each board as seen by one camera alone."""
    rows = np.flatnonzero(corners.camera == local)
    frames = np.unique(corners.frame[rows])
    mine = replace(
        corners.take(rows), frame=np.searchsorted(frames, corners.frame[rows]), camera=np.zeros(len(rows), int)
    )
    used = fit.used[rows].astype(float)
    used[np.bincount(mine.frame, used, len(frames))[mine.frame] == 0] = 1.0  # views may be left out because of a shift
    poses = fit.state.rig[local] @ fit.state.poses[frames]
    start = State.mono(fit.state.cameras[local], poses, fit.state.shape, fit.state.boards)
    found = solve(start, mine, used, default_free(start, lens=False), iterations=12).state.poses
    back, middle = np.linalg.inv(fit.state.rig[local]), dict(zip(path.frame.tolist(), path.middle, strict=True))
    out = {}
    for f, T in zip(frames.tolist(), found, strict=True):
        if f in middle and np.isfinite(T).all():
            out[f] = (back @ T @ np.append(middle[f], 1.0))[:3]
    return out


@dataclass(frozen=True, eq=False)
class InStep:
    """The solution after correction: `fit`, the corrected `corners`, `shifts` by the camera's number, the `late`
    cameras that were corrected, `taken`: (camera, view) → T_cam_board (4, 4) when the image was really taken, and
    `lost`: views (camera, view) that could not be corrected."""

    fit: robust.Fit
    corners: Corners3
    shifts: dict[int, TimeShift]
    late: tuple[int, ...] = ()
    taken: Mapping[tuple[int, int], Array] = field(default_factory=dict)
    lost: Collection[tuple[int, int]] = ()


def in_step(
    task: RigTask, fit: robust.Fit, time: Mapping[str, float], correct: bool, spacing: float, lags: Sequence[int]
) -> InStep:
    """Time shifts of the cameras and, if `correct`, the solution with the corners of clearly shifted ones corrected.

    `lags`: by how many whole moments each camera of `task` is late; its views already are of the moments that follow
    from them, and so only what remains is corrected.
    Iterates time shifts, corners along the boards' paths, and least squares; the result is kept only if it explains the
    corners better. Views of a late camera are left out if the board's path at their true time is unknown.
    """
    shifts = shifts_of(task, fit, Path.of(task, fit.state, time), task.corners, lags)
    first = next((c for c, s in shifts.items() if s.moments == 0), lags.index(0) if 0 in lags else 0)
    late = tuple(c for c, s in shifts.items() if s.clear)
    if not correct or not late:
        return _with_lags(InStep(fit, task.corners, shifts), lags, first)
    now, found, total = _brought(task, fit, time, {c: shifts[c].moments for c in late}, spacing), shifts, {}
    for _ in range(ROUNDS):
        found = shifts_of(task, now.fit, Path.of(task, now.fit.state, time), now.corners, lags, first)
        change = {c: found[c].moments for c in late if c in found}
        total = {c: now.shifts[c].moments + change.get(c, 0.0) for c in late}
        now = _brought(task, now.fit, time, total, spacing)
        if max(map(abs, change.values()), default=0.0) < CONVERGED:
            break
    if not _spread(now.fit) < _spread(fit):
        return _with_lags(InStep(fit, task.corners, shifts), lags, first)
    every = {c: replace(found.get(c, s), moments=total[c]) if c in late else found.get(c, s) for c, s in shifts.items()}
    return _with_lags(replace(now, shifts=every, late=late), lags, first)


def _with_lags(step: InStep, lags: Sequence[int], first: int) -> InStep:
    """The whole shifts, relative to the camera `first`: lags, which views already are corrected for, and what is known
    beyond them. A camera with a lag and nothing clear beyond it is in step."""
    whole = {c: lag - lags[first] for c, lag in enumerate(lags) if lag != lags[first]}
    shifts = {c: replace(s, moments=s.moments + whole.get(c, 0)) for c, s in step.shifts.items()}
    only = {c: TimeShift(float(lag), float("nan")) for c, lag in whole.items() if c not in shifts}
    rest = {c for c, s in step.shifts.items() if s.clear and c not in step.late}
    late = tuple(sorted({*step.late, *(whole.keys() - rest)}))
    return replace(step, shifts=shifts | only, late=late)


def _brought(
    task: RigTask, before: robust.Fit, time: Mapping[str, float], late: Mapping[int, float], spacing: float
) -> InStep:
    """The solution with the corners of the `late` cameras (number → moments) corrected for their shift along the paths
    of `before`."""
    corners, _, lost = _corrected(task, before.state, Path.of(task, before.state, time), late)
    sigma = np.where(lost, FAR, task.sigma)
    fit = refitted(replace(task.joint, corners=corners, sigma=sigma), before, spacing)
    corners, taken, lost = _corrected(task, fit.state, Path.of(task, fit.state, time), late)
    gone = {(c, k) for (c, k), rows in task.rows.items() if lost[rows].any()}
    fit = replace(fit, used=fit.used & ~lost, residuals=residuals(fit.state, corners))
    return InStep(fit, corners, {c: TimeShift(by, 0.0) for c, by in late.items()}, tuple(late), taken, gone)


def _spread(fit: robust.Fit) -> float:
    """Median length of all residuals, including those of views left out."""
    return float(np.median(np.nan_to_num(np.linalg.norm(fit.residuals, axis=1), nan=np.inf)))


def _corrected(
    task: RigTask, state: State, path: Path, late: Mapping[int, float]
) -> tuple[Corners3, dict[tuple[int, int], Array], Array]:
    """Corners with the shift of the `late` cameras (number → moments) removed, T_cam_board of their views at their true
    time, and (N,) which corners are of boards with unknown path there."""
    xy, lost, taken = task.corners.xy.copy(), np.zeros(len(task.corners), bool), {}
    for local, by in late.items():
        poses, then = state.poses.copy(), path.later(by)
        known = np.isfinite(then).all(axis=(1, 2))
        poses[path.frame[known]] = then[known]
        rows = np.flatnonzero(task.corners.camera == local)
        some = task.corners.take(rows)
        moved = residuals(state, some) - residuals(
            replace(state, poses=poses), some
        )  # displacement of the corners in the image
        xy[rows] -= np.where(np.isfinite(moved).all(axis=1, keepdims=True), moved, 0.0)
        lost[rows] = np.isin(some.frame, path.frame[~known])
        for (c, k), mine in task.rows.items():
            if c == task.cameras[local] and not lost[mine].any():
                taken[c, k] = state.rig[local] @ task.pose(replace(state, poses=poses), c, k)
    return replace(task.corners, xy=xy), taken, lost


def by_name(shifts: Mapping[int, TimeShift], names: Iterable[str]) -> dict[str, TimeShift]:
    """`shifts` by the names of the cameras."""
    every = list(names)
    return {every[c]: shift for c, shift in shifts.items()}
