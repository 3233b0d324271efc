"""The paper's comparison (section 4.4): calibrate from half of the pictures, then solve only the poses in the other
half.

Reprojection error: root of the mean squared length of observed − projected, px. Every fit starts from the same initial
camera, estimated from the detector's own corners, and runs until it converges; held-out pictures influence the
calibration only through that initial guess.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import Corners3, Prior, State, default_free, lens_prior, residuals
from rcdn.calibration.choose import rms
from rcdn.calibration.shape import FUNCTIONS, Spread, shape_basis, with_spread
from rcdn.calibration.solver import solve
from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.errors import CalibrationError
from rcdn.types import LENS, Array, Camera, CameraModel

SPLITS, FOLDS = 5, 5
SEED = 7
FEWEST = 6
"""least number of pictures for splitting into halves"""
WEAK = 1e-6
"""× the precision of a lens's prior"""
WIDE = 10.0
"""squares; prior standard deviation of a shape of the first degree: the corners alone determine the shape"""


@dataclass(frozen=True, eq=False)
class Task:
    """Corners of one detector: `corners` of V views (one per picture), `weight` (N,) 1 / px, `used` (N,) bool, the
    inliers; what is fitted: the lens `model` and, if `shaped`, the shape of the board; `start`: an initial camera and
    `T` (V, 4, 4) poses under it."""

    corners: Corners3
    weight: Array
    used: Array
    model: CameraModel
    shaped: bool
    start: Camera
    T: Array

    @property
    def views(self) -> int:
        return len(self.T)

    def of(self, views: Sequence[int] | Array) -> Array:
        """Indices of the used corners of `views`."""
        return np.flatnonzero(self.used & np.isin(self.corners.frame, views))


def task_of(
    boards: Sequence[tuple[Array, Array]],
    image_size: tuple[int, int],
    size: tuple[int, int],
    model: CameraModel,
    shaped: bool = False,
) -> Task:
    """A task with equal weights for all corners of `boards`: labels (M, 2) and pixels (M, 2) of each. Raises
    CalibrationError if one has no pose."""
    seen = [Seen(ij.astype(float), xy) for ij, xy in boards]
    start = first_camera(seen, image_size)
    T = poses(start, seen)
    if not np.isfinite(T).all():
        raise CalibrationError("no pose fits one of the boards")
    frame = np.repeat(np.arange(len(seen)), [len(s.xy) for s in seen])
    ij = np.concatenate([b[0] for b in boards])
    corners = Corners3(frame, 0 * frame, ij.astype(float), np.concatenate([s.xy for s in seen]), shape_basis(ij, size))
    return Task(corners, np.ones(len(frame)), np.ones(len(frame), bool), model, shaped, start, T)


def camera_of(task: Task, views: Sequence[int] | Array) -> State:
    """Lens and poses by least squares from the used corners of `views`."""
    camera = Camera(task.start.K, np.zeros(len(LENS[task.model])), task.start.image_size, task.model)
    state = _start(task, camera)
    mine = task.of(views)
    return solve(state, task.corners.take(mine), task.weight[mine], default_free(state, shape=True)).state


def _start(task: Task, camera: Camera) -> State:
    """The initial state: positions on the board are in squares, and weak priors act only on what the corners do not
    determine."""
    state = State.mono(camera, task.T, np.zeros((len(FUNCTIONS), 3)) if task.shaped else None)
    prior = lens_prior(state)
    state = replace(state, prior=Prior(prior.mean, WEAK * prior.precision))
    return with_spread(state, Spread(WIDE, WIDE)) if task.shaped else state


def posed(state: State, task: Task, views: Sequence[int] | Array) -> State:
    """The camera of `state` with poses of `views` fitted to their used corners; the other poses are meaningless."""
    mine = task.of(views)
    corners = task.corners.take(mine)
    seen = [Seen(corners.board[corners.frame == v], corners.xy[corners.frame == v]) for v in views]
    T = task.T.copy()
    T[np.asarray(views)] = poses(state.cameras[0], seen)
    lost = ~np.isfinite(T).all(axis=(1, 2))
    T[lost] = task.T[lost]
    start = replace(state, poses=T)
    return solve(start, corners, task.weight[mine], default_free(start, lens=False)).state


def pose_gaps(state: State, task: Task, views: Sequence[int] | Array) -> Array:
    """Residuals (n, 2) of the used corners of `views` with the camera of `state` and only their poses fitted; NaN where
    it has no projection."""
    return residuals(posed(state, task, views), task.corners.take(task.of(views)))


def without_outliers(task: Task) -> Task:
    """The task without the corners and views that are outliers by the criteria of `rcdn.calibrate`."""
    none = np.zeros(len(task.corners))
    state = _start(task, Camera(task.start.K, np.zeros(len(LENS[task.model])), task.start.image_size, task.model))
    free = default_free(state, shape=True)
    fit = robust.fit(*robust.initial_fit(state, task.corners, none, free), task.corners, none, free)
    return replace(task, used=fit.used)


def weighted(task: Task, sigma: Array) -> Task:
    """The task with each corner weighted by its `sigma` (N,) px and the additional noise of all."""
    state = camera_of(task, range(task.views))
    _, noise = robust.initial_fit(state, task.corners, sigma, default_free(state, shape=True))
    return replace(task, weight=1 / np.sqrt(noise**2 + sigma**2))


# ---- splits


def halves(count: int) -> list[tuple[Array, Array]]:
    """`SPLITS` splits of `count` pictures into two halves: every other one, then random ones (the same for all
    detectors)."""
    orders = [np.r_[0:count:2, 1:count:2]]
    orders += [np.random.default_rng([SEED, k]).permutation(count) for k in range(SPLITS - 1)]
    return [(np.sort(o[: (count + 1) // 2]), np.sort(o[(count + 1) // 2 :])) for o in orders]


def folds(count: int) -> list[Array]:
    """`FOLDS` parts of `count` pictures."""
    return [np.arange(count)[k::FOLDS] for k in range(FOLDS)]


@dataclass(frozen=True)
class Errors:
    """Reprojection errors, px. `fit`: of all pictures, calibrated from all. `cal`: of the pictures calibrated from, in
    halves; `pose`: of the other half; each over both directions, the median over the splits; `unsteady`: the largest
    `pose` of a split ÷ their median. `folds`: of pictures held out in five parts. `camera`: the same with the cameras
    of these folds and the poses of reference corners."""

    fit: float = float("nan")
    cal: float = float("nan")
    pose: float = float("nan")
    unsteady: float = float("nan")
    folds: float = float("nan")
    camera: float = float("nan")


@dataclass(frozen=True, eq=False)
class Half:
    """Calibrated from `mine`, only poses solved on `others` (view numbers): residuals `cal` and `pose` (n, 2) px, and
    the state of `others`."""

    mine: Array
    others: Array
    cal: Array
    pose: Array
    state: State


def half(task: Task, mine: Array, others: Array) -> Half:
    """One direction of one split."""
    state = camera_of(task, mine)
    held = posed(state, task, others)
    gaps = residuals(held, task.corners.take(task.of(others)))
    return Half(mine, others, residuals(state, task.corners.take(task.of(mine))), gaps, held)


def errors(task: Task, references: Sequence[Task] = ()) -> Errors:
    """All figures of a task; `references`: the same views by other detectors, whose corners evaluate this task's
    cameras."""
    views = np.unique(task.corners.frame[task.used])
    if len(views) < FEWEST:
        return Errors()
    whole = camera_of(task, views)
    of = task.of(views)
    fit = root_mean_square([residuals(whole, task.corners.take(of))])
    cals, held = zip(*(_both_ways(task, views[a], views[b]) for a, b in halves(len(views))), strict=True)
    pose = float(np.median(held))
    by_fold, by_camera = _by_fold(task, references, views)
    return Errors(fit, float(np.median(cals)), pose, max(held) / pose, by_fold, by_camera)


def _both_ways(task: Task, a: Array, b: Array) -> tuple[float, float]:
    """Calibration and pose error over both directions of one split."""
    both = [half(task, a, b), half(task, b, a)]
    return root_mean_square([h.cal for h in both]), root_mean_square([h.pose for h in both])


def _by_fold(task: Task, references: Sequence[Task], views: Array) -> tuple[float, float]:
    own, others = [], []
    for part in folds(len(views)):
        out = views[part]
        state = camera_of(task, np.setdiff1d(views, out))
        own.append(pose_gaps(state, task, out))
        others += [pose_gaps(state, reference, out) for reference in references]
    return root_mean_square(own), root_mean_square(others) if others else float("nan")


def root_mean_square(parts: Sequence[Array]) -> float:
    """Root mean square length of all residuals, parts of (n, 2) px; infinite if a corner has no projection."""
    gaps = np.concatenate(parts)
    return rms(np.nan_to_num(gaps, nan=np.inf), np.ones(len(gaps)))
