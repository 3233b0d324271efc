"""Each rig calibrated without a part of its moments, by each solver, and scored on that part;
and how pairs of cameras close."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig, calibrate_stereo
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry import cross_matrix
from rcdn.types import Array, BoardShape, Rig
from rcdn_lab.real_rigs.opencv import opencvs
from rcdn_lab.real_rigs.score import Scored, scored
from rcdn_lab.real_rigs.sets import Shots

Known = tuple[Rig, BoardShape | None]
LOST = 100.0
"""px; a corner that a camera can't see counts as this far off"""
DIVERGED = 20.0
"""px between a corner and its triangulated point, RMS of a part, from which on a solver's rig is none"""


@dataclass(frozen=True, eq=False)
class Chain:
    """Three cameras by `names`, each two calibrated apart: `gap` (6,) of the way round (rad, then lengths),
    and its stated `covariance`."""

    names: tuple[str, str, str]
    gap: Array
    covariance: Array


def ours(shots: Shots, spacing: float, model: str = "auto") -> Known:
    """Our rig, told the spacing and perhaps the lens model, and the board's shape that came with it."""
    views, moments = shots.arguments()
    found = calibrate_rig(views, spacing, moments=moments, model=model)
    whole = found.components == (tuple(shots.boards),)
    if not whole:
        raise CalibrationError(f"connects only {', '.join(found.rig.names)}")
    return found.rig, next(c.shape for c in found.cameras.values())


def theirs(shots: Shots, spacing: float) -> Known:
    """OpenCV's rig; its board is flat."""
    return opencvs(shots, spacing), None


def theirs_of_parts(shots: Shots, spacing: float) -> Known:
    """OpenCV's rig, from boards that were seen in part, too."""
    return opencvs(shots, spacing, parts=True), None


PARTS = "opencv, parts too"
SOLVERS: dict[str, Callable[[Shots, float], Known]] = {
    "rcdn": ours,
    "rcdn, brown": partial(ours, model="brown"),  # the lens model that OpenCV's solver has
    "opencv": theirs,
    PARTS: theirs_of_parts,
}


def folds(shots: Shots, count: int) -> list[list[str]]:
    """The moments at which two cameras saw the board, dealt out in turn."""
    shared = [m for m in shots.moments if sum(m in each for each in shots.boards.values()) > 1]
    return [part for k in range(count) if (part := shared[k::count])]


def held_out(shots: Shots, solver: str, spacing: float, count: int) -> dict[str, Any]:
    """The figures of one solver over `count` parts of the moments, each scored by a rig that was
    calibrated from the other parts.

    Parts without a rig are in `failed`, with its reason in `why`.
    """
    found: list[Scored] = []
    parts, why = folds(shots, count), []
    for part in parts:
        try:
            rig, shape = SOLVERS[solver](shots.only(set(shots.moments) - set(part)), spacing)
        except (CalibrationError, ConfigError) as error:
            why.append(str(error)[:200])
            continue
        some = _of_moments(rig, shots, part, spacing, shape)
        if (miss := figures(some)["rays_px"]) < DIVERGED:
            found += some
        else:
            why.append(f"held out, its rays miss each other by {miss:.0f} px")
    return {**figures(found), "parts": len(parts), "failed": len(why), "why": why[0] if why else ""}


def of_rig(rig: Rig, shots: Shots, spacing: float) -> dict[str, Any]:
    """The figures of a rig that another program made, over all moments."""
    return {**figures(_of_moments(rig, shots, shots.moments, spacing, None)), "parts": 0, "failed": 0, "why": ""}


def _of_moments(
    rig: Rig, shots: Shots, moments: Sequence[str], spacing: float, shape: BoardShape | None
) -> list[Scored]:
    seen = [{n: each[m] for n, each in shots.boards.items() if m in each} for m in moments]
    return [s for boards in seen if (s := scored(rig, boards, spacing, shape)) is not None]


def figures(found: Sequence[Scored]) -> dict[str, Any]:
    """Root mean squares of all moments: `step_permille` and `span_permille` of the spacing and of whole rows,
    `step_scatter` and `span_scatter` of the same length at different moments, ‰, `rays_px` and `board_px`."""
    parts = {k: np.concatenate([getattr(s, k) for s in found] or [np.full(1, np.nan)]) for k in ("steps", "spans")}
    ends = {k: np.concatenate([getattr(s, k) for s in found] or [np.zeros((1, 4))]) for k in ("step_ends", "span_ends")}
    px = {k: np.concatenate([getattr(s, k) for s in found] or [np.full(1, np.nan)]) for k in ("rays", "board")}
    return {
        "moments": len(found),
        "step_permille": 1000 * _rms(parts["steps"]),
        "span_permille": 1000 * _rms(parts["spans"]),
        "step_scatter": 1000 * _scatter(parts["steps"], ends["step_ends"]),
        "span_scatter": 1000 * _scatter(parts["spans"], ends["span_ends"]),
        "rays_px": _rms(np.nan_to_num(px["rays"], nan=LOST)) if found else float("nan"),
        "board_px": _rms(np.nan_to_num(px["board"], nan=LOST)) if found else float("nan"),
    }


def _scatter(values: Array, ends: Array) -> float:
    """The pooled standard deviation of `values` (E,) about the mean of those with the same `ends` (E, 4): whatever the
    board's true lengths are, they are the same at each moment."""
    known = np.isfinite(values)
    values, which = values[known], np.unique(ends[known], axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(which)
    mean = np.bincount(which, values) / np.maximum(count, 1)
    free = float(np.maximum(count - 1, 0).sum())
    return float(np.sqrt(((values - mean[which]) ** 2).sum() / free)) if free else float("nan")


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")


def chain(shots: Shots, names: tuple[str, str, str], spacing: float) -> Chain:
    """Cameras a, b, c, each two by `calibrate_stereo` of the boards that both saw:
    T_c_a by way of b against T_c_a itself."""
    a, b, c = names
    (T_ba, C_ba), (T_cb, C_cb), (T_ca, C_ca) = (_pair(shots, *pair, spacing) for pair in ((a, b), (b, c), (a, c)))
    D = T_cb @ T_ba @ np.linalg.inv(T_ca)
    J, K = _motion_past(T_cb), _motion_past(D)
    gap = np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])
    return Chain(names, gap, C_cb + J @ C_ba @ J.T + K @ C_ca @ K.T)


def closing(shots: Shots, spacing: float) -> dict[str, Any]:
    """Of the `chain` of three cameras: `chi2` of its gap ÷ 6 (1 by chance), and the largest gap in stated
    deviations, `most_sigma`."""
    names = tuple(shots.boards)
    found = chain(shots, (names[0], names[1], names[2]), spacing)
    return {
        "chi2": float(found.gap @ np.linalg.solve(found.covariance, found.gap)) / 6,
        "most_sigma": float(np.abs(found.gap / np.sqrt(np.diag(found.covariance))).max()),
    }


def renamed(rig: Rig, shots: Shots) -> Rig:
    """A rig whose cameras have numbers, with the names of the cameras of the shots, in their order."""
    order = list(shots.boards)
    at = [k for k in range(len(rig)) if k < len(order)]
    return Rig(tuple(order[k] for k in at), tuple(rig.cameras[k] for k in at), tuple(rig.poses[k] for k in at))


def _pair(shots: Shots, a: str, b: str, spacing: float) -> tuple[Array, Array]:
    left, right = shots.boards[a], shots.boards[b]
    pairs = [(k, list(right).index(m)) for k, m in enumerate(left) if m in right]
    done = calibrate_stereo(list(left.values()), list(right.values()), spacing, pairs=pairs)
    return done.T_right_left, done.cov


def _motion_past(T: Array) -> Array:
    """(6, 6) takes a small motion before T to the same one after it."""
    R = T[:3, :3]
    return np.block([[R, np.zeros((3, 3))], [cross_matrix(T[:3, 3]) @ R, R]])
