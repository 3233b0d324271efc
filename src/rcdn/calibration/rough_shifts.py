"""A first, robust estimate of the time shifts between the cameras of a rig, from where each alone sees moving boards.

A camera that is late by τ sees a board at its position τ after the nominal moment, along its path: its own place of the
board and the mean of all cameras at that moment differ by (τ − mean τ) × the board's velocity, which is linear in all τ
at once. Lenses are taken for known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from rcdn.calibration import robust
from rcdn.calibration.board_paths import Path
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.solver import solve
from rcdn.geometry import cross_matrix
from rcdn.types import Array

FEWEST_MOVES = 6
"""fewest moments with a moving board for the estimate of a time shift"""


@dataclass(frozen=True, eq=False)
class Rough:
    """A first estimate of the time shifts: by how many moments each camera, by its number, is late (`moments`), against
    one camera of each group that moving boards connect (`references`; the first one is that which agrees best with
    the others)."""

    moments: dict[int, float]
    references: tuple[int, ...]


def rough_shifts(task: RigTask, fit: robust.Fit, path: Path, lags: Sequence[int]) -> Rough:
    """By how many moments each camera is late beyond its whole moments `lags`.

    A camera's pose was estimated as if it had no shift, and absorbed a part of it: a small motion of each camera is
    therefore unknown, too; lenses are taken for known. Least absolute residuals (reweighted). Cameras that saw fewer
    than FEWEST_MOVES moving boards together with others are left out.
    """
    v, moving, points = path.velocity, path.moving, path.places
    at = {f: k for k, f in enumerate(path.frame.tolist()) if moving[k]}
    seen: dict[int, dict[int, Array]] = {}
    for local in range(len(task.cameras)):
        for f, place in _own_places(fit, path, task.corners, local).items():
            if f in at:
                seen.setdefault(at[f], {})[local] = place
    rows, misses, camera = [], [], []
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
            camera.append(local)
    counts = np.bincount(np.array(camera, int), minlength=len(task.cameras))
    known = np.flatnonzero(counts >= FEWEST_MOVES)
    if len(known) < 2:
        return Rough({}, (lags.index(0) if 0 in lags else 0,))
    columns = (7 * known[:, None] + np.arange(7)).ravel()
    tau = _least_absolute(np.array(rows)[:, :, columns], np.array(misses))[::7]
    return _against_references(known, tau, tau + np.array(lags)[known], [set(places) for places in seen.values()])


def _against_references(known: Array, tau: Array, late: Array, together: Sequence[set[int]]) -> Rough:
    """The shifts `tau` (K,) of the cameras `known` (K,) against one of each group that moving boards connect, which
    the cameras of a set in `together` saw at once. `late` (K,): the same with whole moments."""
    seen = np.array([[c in each for c in known.tolist()] for each in together], int)
    group = connected_components(seen.T @ seen)[1]
    moments, references = dict[int, float](), list[tuple[int, int]]()
    for g in range(int(group.max()) + 1):
        mine = np.flatnonzero(group == g)
        apart = np.abs(late[mine, None] - late[None, mine]).sum(axis=1)
        zero = mine[np.argmin(apart.round(9))]
        references.append((-len(mine), int(known[zero])))
        moments |= dict(zip(known[mine].tolist(), (tau[mine] - tau[zero]).tolist(), strict=True))
    return Rough(moments, tuple(c for _, c in sorted(references)))


def _least_absolute(A: Array, d: Array) -> Array:
    """x (n,) that minimises Σ |d − A x| for `A` (R, 3, n), `d` (R, 3), of least norm."""
    weight, x = np.ones(len(d)), np.zeros(A.shape[2])
    for _ in range(20):
        H = np.einsum("r,rik,ril->kl", weight, A, A)
        x = np.linalg.pinv(H, rcond=1e-9) @ np.einsum("r,rik,ri->k", weight, A, d)
        gap = np.linalg.norm(d - A @ x, axis=1)
        weight = 1 / np.maximum(gap, 0.1 * np.median(gap) + 1e-12)
    return np.asarray(x)


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
