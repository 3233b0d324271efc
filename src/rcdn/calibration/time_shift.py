"""Time shifts between cameras: estimated from moving boards, and corrected by moving corners to the nominal moments of
their images.

A camera that is late by τ sees a board at its position τ after the nominal moment, along its path. From a first
estimate (`rough_shifts`) on, shifts are unknowns of the joint least squares, beside lenses, places and boards. For the
correction, the path between moments is interpolated by a polynomial through five of them, or three. After correction
the least squares say what remains: the root of that is looked for by Newton's method.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.board_paths import Path
from rcdn.calibration.bundle import Corners3, State, residuals
from rcdn.calibration.rig_fit import Joint, refitted
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.rough_shifts import Rough, rough_shifts
from rcdn.calibration.solver import Normal, solve
from rcdn.calibration.uncertainty import UNBIASED, clustered
from rcdn.types import Array, TimeShift

FAR = 1e3
"""px, sigma that removes corners from the fit"""
PROBE, PASSES = 0.1, 3
"""moments between two corrections that tell the slope of what remains; solutions, each by the paths of the one before,
for either"""
ROUNDS, CONVERGED, SHARE = 5, 0.005, 0.1
"""largest number of rounds of correction and fit; changes, in moments, at which they end: all are smaller than this, or
than this share of their standard deviations"""
LONGEST = 1.0
"""moments; longest step towards the root"""
TRIED, FAINT = 3.0, 0.0125
"""standard deviations of a shift, and moments, as seen without correction, from which one is tried: where lenses can
take up most of it, a shift is some four times as large as it seems"""


def joint_shifts(task: RigTask, fit: robust.Fit, corners: Corners3, path: Path, rough: Rough) -> dict[int, TimeShift]:
    """Time shifts of the cameras of `rough`, against its references, beside all unknowns of the solution `fit` of the
    `corners`: one Gauss–Newton step from no shift, with the covariance from the residuals of whole moments.

    Boards whose velocity isn't known are left out, and so are cameras of whose shift the others tell nothing.
    """
    here = _with_lateness_free(fit, path, rough.moments.keys() - set(rough.references))
    weight = np.where(np.isin(corners.frame, path.frame[~path.near]), 0.0, fit.weight)
    normal = Normal.of(here.state, corners, weight, here.free)
    arrow = normal.arrow()
    honest = clustered(here.state, corners, weight, here.free, arrow, fit.scale, task.cluster, UNBIASED)
    moments = np.zeros(len(here.free))
    moments[here.free] = arrow.solve(*normal.gradient)[1]
    moments, std = moments[here.state.lateness], _deviations(replace(here, clustered=honest))
    zero = {c: TimeShift(0.0, 0.0) for c in rough.references if c in rough.moments}
    return zero | {c: TimeShift(float(moments[c]), float(std[c])) for c in rough.moments if std[c] > 0}


def _with_lateness_free(
    fit: robust.Fit, path: Path, late: Collection[int], start: Mapping[int, float] | None = None
) -> robust.Fit:
    """`fit` in which the lateness of the cameras `late` is unknown, before it is solved; `start`: their moments."""
    velocity = np.zeros((len(fit.state.poses), 6))
    velocity[path.frame] = path.motion
    old, bends = fit.state.late.size, fit.state.shape.size
    unknown, moments = np.zeros(len(fit.state.cameras), bool), np.zeros(len(fit.state.cameras))
    unknown[list(late)] = True
    moments[list(start or {})] = list((start or {}).values())
    state = replace(fit.state.with_velocity(velocity), late=moments)
    before, shape = fit.free[: len(fit.free) - bends - old], fit.free[len(fit.free) - bends :]
    return replace(fit, state=state, free=np.concatenate([before, unknown, shape]))


def _deviations(fit: robust.Fit) -> Array:
    """(C,) standard deviations of the cameras' lateness, moments; 0 for those held, or that nothing tells."""
    variance = np.zeros(len(fit.free))
    variance[fit.free] = np.diag(fit.clustered.covariance)
    return np.asarray(np.sqrt(np.maximum(variance[fit.state.lateness], 0.0)))


def _with_slope(fit: robust.Fit, late: Sequence[int], slope: Array) -> robust.Fit:
    """`fit` with the covariance of the root instead of that of what remains of the shifts of the cameras `late`, of
    which the latter falls by `slope` (C, C) with the corrections; all other unknowns follow them as before."""
    cov, at = fit.clustered.covariance, (np.cumsum(fit.free) - 1)[fit.state.lateness][late]
    gain, remainder = np.linalg.pinv(slope), cov[np.ix_(at, at)]
    follow = cov[:, at] @ np.linalg.pinv(remainder)
    cov = cov + follow @ (gain @ remainder @ gain.T - remainder) @ follow.T
    return replace(fit, clustered=replace(fit.clustered, covariance=cov))


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
    Iterates corners along the boards' paths, and least squares in which the shifts are unknown, also if they are only
    told; cameras whose shift isn't clear then are taken for in step. The result is kept only if it explains the corners
    better. Views of a late camera are left out if the board's path at their true time is unknown.
    """
    path = Path.of(task, fit.state, time)
    rough = rough_shifts(task, fit, path, lags)
    found = as_is = InStep(
        fit, task.corners, joint_shifts(task, fit, task.corners, path, rough) if rough.moments else {}
    )
    late = _candidates(rough, as_is.shifts)
    for _ in range(ROUNDS):
        if not late:
            break
        found = _corrected_solution(task, fit, time, late, spacing, rough)
        clear = {c: s.moments for c, s in found.shifts.items() if s.clear}
        done, late = clear.keys() == late.keys(), clear
        if done:
            break
    if not late:
        found = replace(as_is, shifts=found.shifts)
    elif not _spread(found.fit) < _spread(fit):
        found = as_is
    return _with_lags(found if correct else replace(as_is, shifts=found.shifts), lags, rough.references[0])


def _candidates(rough: Rough, joint: Mapping[int, TimeShift]) -> dict[int, float]:
    """The cameras that may be late, with a first estimate of their shift, by their `rough` and `joint` shifts."""
    large = {c: by for c, by in rough.moments.items() if TimeShift(by, 0.0).clear}
    return {c: s.moments for c, s in joint.items() if abs(s.moments) > max(TRIED * s.std, FAINT)} | large


def _with_lags(step: InStep, lags: Sequence[int], first: int) -> InStep:
    """The whole shifts, relative to the camera `first`: lags, which views already are corrected for, and what is known
    beyond them. A camera with a lag and nothing clear beyond it is in step."""
    whole = {c: lag - lags[first] for c, lag in enumerate(lags) if lag != lags[first]}
    shifts = {c: replace(s, moments=s.moments + whole.get(c, 0)) for c, s in step.shifts.items()}
    only = {c: TimeShift(float(lag), float("nan")) for c, lag in whole.items() if c not in shifts}
    rest = {c for c, s in step.shifts.items() if s.clear and c not in step.late}
    late = tuple(sorted({*step.late, *(whole.keys() - rest)}))
    return replace(step, shifts=shifts | only, late=late)


def _corrected_solution(
    task: RigTask,
    before: robust.Fit,
    time: Mapping[str, float],
    late: Mapping[int, float],
    spacing: float,
    rough: Rough,
) -> InStep:
    """The solution in which the cameras `late` (number → moments, a first estimate) are late; shifts of all cameras of
    `rough`."""
    fit, those, at, slope = before, list(late), np.array(list(late.values())), np.zeros((0, 0))
    held = np.zeros(len(at))
    for number in range(ROUNDS):
        start, joint = _corrected(task, fit, time, dict(zip(those, at, strict=True)), held)
        fit = refitted(joint, start, spacing)
        remainder = fit.state.late[those]
        held = at + remainder
        if not number:
            slope = _slope(task, fit, time, dict(zip(those, at, strict=True)))
        step = np.clip(-np.linalg.pinv(slope) @ remainder, -LONGEST, LONGEST)
        at, std = at + step, _deviations(_with_slope(fit, those, slope))[those]
        if number and (np.abs(step) < np.maximum(CONVERGED, SHARE * std)).all():
            break
    fit, total = _with_slope(fit, those, slope), dict(zip(those, at.tolist(), strict=True))
    path, state = Path.of(task, fit.state, time), fit.state.with_velocity(fit.state.velocity)
    corners, taken, lost = _moved(task, state, path, total)
    gone = {(c, k) for (c, k), rows in task.rows.items() if lost[rows].any()}
    used, weight = fit.used & ~lost, np.where(lost, 0.0, fit.weight)
    fit = replace(fit, state=state, used=used, weight=weight, residuals=residuals(state, corners))
    shifts = joint_shifts(task, fit, corners, path, rough)
    shifts |= {c: TimeShift(total[c], float(d)) for c, d in zip(those, std, strict=True) if d > 0}
    return InStep(fit, corners, shifts, tuple(late), taken, gone)


def _corrected(
    task: RigTask, fit: robust.Fit, time: Mapping[str, float], late: Mapping[int, float], held: Array
) -> tuple[robust.Fit, Joint]:
    """The problem with the corners of the cameras `late` (number → moments) corrected, and its start, which holds by
    how many moments these are late (`held`, (C,)), so that residuals are those of `fit`."""
    path = Path.of(task, fit.state, time)
    corners, _, lost = _moved(task, fit.state, path, late)
    start = _with_lateness_free(fit, path, late, {c: h - by for (c, by), h in zip(late.items(), held, strict=True)})
    return start, replace(task.joint, corners=corners, sigma=np.where(lost, FAR, task.sigma))


def _slope(task: RigTask, fit: robust.Fit, time: Mapping[str, float], late: Mapping[int, float]) -> Array:
    """(C, C) how what remains of the shifts of the cameras `late` changes with the moments by which their corners are
    corrected, near the solution `fit`, whose weights are kept.

    Minus the unit matrix, were the boards' paths known; they follow from the same poses, and where lenses can take up
    most of a shift, less remains to be seen.
    """
    those, at = list(late), np.array(list(late.values()))

    def remainder(by: Array) -> Array:
        here, held = fit, at + fit.state.late[those]
        for _ in range(PASSES):
            here, joint = _corrected(task, here, time, dict(zip(those, by, strict=True)), held)
            weight = np.where(joint.sigma >= FAR, 0.0, fit.weight)
            here = replace(here, state=solve(here.state, joint.corners, weight, here.free).state)
            held = by + here.state.late[those]
        return here.state.late[those]

    before = remainder(at)
    return np.stack([(remainder(at + PROBE * e) - before) / PROBE for e in np.eye(len(at))], axis=1)


def _spread(fit: robust.Fit) -> float:
    """Median length of all residuals, including those of views left out."""
    return float(np.median(np.nan_to_num(np.linalg.norm(fit.residuals, axis=1), nan=np.inf)))


def _moved(
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
