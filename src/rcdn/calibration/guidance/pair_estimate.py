"""The present estimate of two cameras in a guided calibration: from a prior at first, then from the pictures alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.added_pair import PairCovariance
from rcdn.calibration.added_view import weight_of
from rcdn.calibration.bundle import Prior, default_free
from rcdn.calibration.guidance.first_guess import SCATTER, camera_prior, first_guess
from rcdn.calibration.guidance.progress import FEWEST, Wish
from rcdn.calibration.labels import Size
from rcdn.calibration.relative_pose import FEWEST_PAIRS, determines_pose, hypotheses
from rcdn.calibration.solver import solve
from rcdn.calibration.stereo import StereoSolution, pair_task, stereo_solution
from rcdn.calibration.uncertainty import Clustered, covariance
from rcdn.errors import CalibrationError
from rcdn.types import Board, Calibration, Plane, StereoCalibration

Moment = tuple[Board | None, Board | None]
"""the board in the left and in the right picture of one moment, None where it isn't used"""
Wishes = tuple[Wish, Wish]
GROWN = 1.5
"""× the moments of the last choice of a lens model: with as many it is made again"""


@dataclass(frozen=True, eq=False)
class PairKnown:
    """The present estimate: `stereo` from the accepted pairs, None until they determine it; `sides`, the best available
    calibration of each camera; `pair`, both with their covariance, None until both have seen the whole board at once;
    the pairs' `names`; the board's `size` (columns, rows) in corners and `plane`; `trouble`: why there is no `stereo`;
    `lens`: the lens model to go on with, chosen among all with the first `chosen` moments."""

    stereo: StereoCalibration | None
    sides: tuple[Calibration, Calibration]
    pair: PairCovariance | None
    names: tuple[str, ...]
    size: Size | None
    plane: Plane
    trouble: str = ""
    lens: str = "auto"
    chosen: int = 0


def pair_learned(
    wishes: Wishes,
    moments: Sequence[Moment],
    names: Sequence[str],
    size: Size | None,
    plane: Plane,
    before: PairKnown | None = None,
) -> PairKnown:
    """The estimate from the boards of `moments`; `before`: the last one."""
    boards, named, pairs = by_camera(moments, names)
    trouble, lens = "", _lens(wishes[0].model, len(moments), before)
    if len(pairs) >= FEWEST_PAIRS:
        try:
            found = stereo_solution(*boards, wishes[0].spacing, pairs=pairs, names=named, model=lens, size=size)
            if np.isfinite(found.cov).all():
                sides = (found.stereo.left, found.stereo.right)
                chosen = before.chosen if before is not None and lens != "auto" else len(moments)
                known = PairKnown(found.stereo, sides, _solved(found), tuple(names), size, plane)
                return replace(known, lens=_common(s.models[0].model for s in sides), chosen=chosen)
        except CalibrationError as error:
            trouble = str(error)
    guesses = [first_guess(w.image_size, b, n, w.spacing, size) for w, b, n in zip(wishes, boards, named, strict=True)]
    first, second = (
        replace(g, size=size, orientation=_orientation(b, size)) for g, b in zip(guesses, boards, strict=True)
    )
    pair = _guessed(wishes, first, second)
    if pair is not None:
        first, second = (replace(g, camera=c) for g, c in zip((first, second), pair.cameras, strict=True))
    guessed = _common(s.camera.model for s in (first, second))
    return PairKnown(None, (first, second), pair, tuple(names), size, plane, trouble, guessed)


def _lens(wanted: str, n: int, before: PairKnown | None) -> str:
    """The lens model with which to calibrate from `n` moments. A choice among all takes most of the time, and from few
    moments it isn't settled: below FEWEST the first guess's is kept, then the choice is made again whenever the number
    of moments has grown by half."""
    if wanted != "auto" or before is None:
        return wanted
    if n < FEWEST or (before.chosen >= FEWEST and n < GROWN * before.chosen):
        return before.lens
    return "auto"


def _common(models: Iterable[str]) -> str:
    """The lens model of both cameras; `auto` if they have different ones."""
    found = set(models)
    return found.pop() if len(found) == 1 else "auto"


def by_camera(
    moments: Sequence[Moment], names: Sequence[str]
) -> tuple[tuple[list[Board], list[Board]], tuple[list[str], list[str]], list[tuple[int, int]]]:
    """The boards of each camera, their names, and (index in left, index in right) of those of one moment."""
    boards: tuple[list[Board], list[Board]] = ([], [])
    named: tuple[list[str], list[str]] = ([], [])
    pairs = []
    for moment, name in zip(moments, names, strict=True):
        if moment[0] is not None and moment[1] is not None:
            pairs.append((len(boards[0]), len(boards[1])))
        for side, board in enumerate(moment):
            if board is not None:
                boards[side].append(board)
                named[side].append(name)
    return boards, named, pairs


def _orientation(boards: Sequence[Board], size: Size | None):  # type: ignore[no-untyped-def]
    return next((b.orientation for b in boards if size is not None and sorted(b.size) == sorted(size)), None)


def _solved(found: StereoSolution) -> PairCovariance:
    """From a joint solution. The weight of a corner is such that all pictures together have the information that the
    covariance states: residuals of one view are correlated (`added_view.share_known`)."""
    many = len(found.cov) - 6
    ratio = float(np.trace(found.cov[:many, :many] @ np.linalg.pinv(found.single, hermitian=True))) / many
    share = 1 / ratio if np.isfinite(ratio) and ratio > 0 else 1.0
    left, right = (weight_of(c) * float(np.sqrt(share)) for c in (found.stereo.left, found.stereo.right))
    cameras = found.stereo.left.camera, found.stereo.right.camera
    return PairCovariance(cameras, found.stereo.T_right_left, found.cov, found.used, (left, right))


def _guessed(wishes: Wishes, first: Calibration, second: Calibration) -> PairCovariance | None:
    """The maximum a posteriori estimate under the prior of `first_guess` for each camera; None without a pair of whole
    boards."""
    there = {v.name: k for k, v in enumerate(second.views)}
    every = [(k, there[v.name]) for k, v in enumerate(first.views) if v.name in there]
    pairs = [(a, b) for a, b in every if determines_pose(first.views[a], second.views[b])]
    if not pairs or first.size is None:
        return None
    poses = hypotheses(first, second, pairs)
    T, _ = poses.most_agreed()
    turned = {b: int(turn) for (_, b), turn in zip(pairs, poses.nearest(T)[1], strict=True)}
    task = pair_task(first, second, pairs, turned)
    state = task.start((first, second), {0: np.eye(4), 1: T})
    lenses = [
        camera_prior(w.image_size, c.camera.model, len(c.camera.distortion))
        for w, c in zip(wishes, (first, second), strict=True)
    ]
    state = replace(state, prior=_joined(lenses, sum(state.counts)))
    weight = 1 / np.hypot(SCATTER, task.sigma)
    free = default_free(state, rig=True)
    done = solve(state, task.corners, weight, free)
    frames = np.arange(len(task.keys))
    cov = covariance(done.arrow, frames, 1.0, Clustered(done.arrow.covariance, 1.0))
    median_weight = float(np.median(weight))
    cameras = done.state.cameras
    return PairCovariance((cameras[0], cameras[1]), done.state.rig[1], cov, len(frames), (median_weight, median_weight))


def _joined(lenses: Sequence[Prior], many: int) -> Prior:
    """The prior of both cameras, the first ones of `many` shared parameters; none of the others."""
    mean, precision, at = np.zeros(many), np.zeros((many, many)), 0
    for prior in lenses:
        here = slice(at, at + len(prior.mean))
        mean[here], precision[here, here] = prior.mean, prior.precision
        at += len(prior.mean)
    return Prior(mean, precision)
