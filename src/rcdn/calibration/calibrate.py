"""Calibration of one camera from detected boards: the complete procedure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration import choose, robust, smooth_lens
from rcdn.calibration.advice import judged
from rcdn.calibration.arguments import check_boards, check_truth, given_size, texts
from rcdn.calibration.bundle import State, default_free, with_fixed
from rcdn.calibration.coded import Geometries, Geometry, Spacing
from rcdn.calibration.labels import Labelled, Size
from rcdn.calibration.near_duplicates import alike
from rcdn.calibration.one_thread import one_thread
from rcdn.calibration.residual_facts import mean_residuals
from rcdn.calibration.shape import FEWEST_SHAPED, FUNCTIONS, board_shape
from rcdn.calibration.start import first_camera, poses
from rcdn.calibration.uncertainty import covariance, with_held
from rcdn.calibration.usable import FEWEST_VIEWS, Usable, board_view, one_size, too_few, usable, with_poses
from rcdn.errors import CalibrationError, ConfigError, shown
from rcdn.geometry import folds
from rcdn.types import (
    Array,
    Board,
    BoardView,
    Calibration,
    Camera,
    CameraModel,
    ModelScore,
    Pose,
)
from rcdn.types.arrays import Real

LENSES: dict[str, tuple[CameraModel, int]] = {
    "pinhole": ("pinhole", 0),
    "radtan": ("brown", 4),
    "brown": ("brown", 5),
    "fisheye": ("fisheye", 4),
    "rational": ("rational", 8),
}
"""name → lens model and the number of its distortion coefficients, from the simplest on"""
AUTO = ("pinhole", "brown", "fisheye", "rational")
"""the models that `auto` compares"""
MODELS = ("auto", *LENSES, "splined")
SYSTEMATIC = 0.15
"""share of the sensor's cells with a significant mean residual, above which a smooth correction of the lens is tried"""
FIXABLE = ("aspect", "principal_point")
"""what can be held fixed: the aspect ratio (fx = fy); the principal point (at the centre of the picture)"""
HOPELESS_MODEL = 2.0
"""× the least scatter that any model leaves: a model that leaves more is not fitted any further"""
HOPELESS = 0.2
"""relative standard deviation of the focal length above which the result is refused"""
DIFFERENT_VIEWS = "take pictures of the board tilted by 30° to 45°, to different sides, and near and far"
NOT_SPLINED = "The lens has no smooth correction, with which its projection would fold; it is that of {} alone."


@one_thread()
def calibrate(
    boards: Sequence[Board],
    spacing: Spacing,
    *,
    names: Sequence[str] | None = None,
    model: str = "auto",
    size: Size | None = None,
    flat: bool = False,
    fix: Collection[str] = (),
    leave_out: Sequence[str] = (),
) -> Calibration:
    """Calibrate the camera that took `boards`: intrinsics, poses, residuals and standard deviations.

    `boards`: as returned by `Detector.boards`, including partial boards and several boards per picture, all taken by
    one camera at one zoom. `spacing`: side of a square (of a deltille: of a triangle, of an AprilGrid: of a tag), m;
    for boards of several kinds a dict with the keys `checker`, `deltille`, `charuco`, `aprilgrid`, `puzzleboard`.
    Boards whose codes were read have known positions on their target. `names` of the boards' pictures: boards with the
    same name are held out together (default: each board is a picture of its own). `model`: `pinhole` (no distortion),
    `radtan` (k1 k2 p1 p2), `brown` (with k3), `fisheye` (Kannala–Brandt, 4), `rational` (8), or `auto`: the simplest
    model whose held-out error is close to the least. `size` (columns, rows) of the board in inner corners; default: the
    most frequent size of the complete boards that the picture's border cannot have cut; labels, poses and shape are
    those of a board of that size, as `Board.grid_of` turns it. `flat`: the board is known to be exactly planar and
    evenly spaced, such as one on glass; by default its shape is estimated, too, if five views determine which corner is
    which (`rcdn.calibration.shape`). `fix`: what is held fixed, `aspect` (fx = fy), `principal_point` (the centre of
    the picture), or both. `leave_out`: names of pictures that the estimate must not use, or `name:2` for the second
    board of one; they remain among the views.

    Each corner is weighted by its sigma and by the additional scatter that the corners show. Corners and views that are
    outliers are left out and reported. Covariances are computed from the scatter between whole views
    (`rcdn.calibration.uncertainty.clustered`); nearly identical views count as one. Raises CalibrationError if the
    boards do not determine a camera, ConfigError for a wrong argument.
    """
    check_arguments(boards, names, model, size)
    check_truth(flat, "flat")
    size, fixed = given_size(size), check_fix(fix)
    names = names_of(boards, names)
    leave_out = texts(leave_out, "leave_out")
    if leave_out:
        from rcdn.calibration.by_hand import without  # which imports this module

        return without(
            lambda some, named: calibrate(some, spacing, names=named, model=model, size=size, flat=flat, fix=fix),
            lambda some: Geometries.of(some, spacing, size),
            boards,
            names,
            leave_out,
        )
    geometries = Geometries.of(boards, spacing, size)
    done = judged(with_geometries(boards, geometries, names, model, flat, fixed, strict=size is not None))
    if model == "splined" and done.camera.correction is None:
        return replace(done, advice=(*done.advice, NOT_SPLINED.format(done.camera.model)))
    return done


def with_geometries(
    boards: Sequence[Board],
    geometries: Geometries,
    names: Sequence[str],
    model: str = "auto",
    flat: bool = False,
    fixed: frozenset[str] = frozenset(),
    strict: bool = False,
) -> Calibration:
    """`calibrate` for boards with the given `geometries`, without a verdict; `strict`: plain boards that cannot be part
    of the whole board are refused."""
    image_size, whole = one_size(boards, names), geometries.main
    labels = geometries.labelled(boards, strict)
    task = usable(boards, labels, names, image_size, whole)
    _check_different(task, image_size)
    start = first_camera(task.seen, image_size)
    task, T = with_poses(task, poses(start, task.seen))
    models = AUTO if model in ("auto", "splined") else (model,)
    shaped = not flat and task.settled >= FEWEST_SHAPED
    fits = _fits(task, models, start, T, whole.spacing, fixed, shaped)
    chosen, scores = _choose(task, fits)
    if shaped and _flat_predicts_better(task, fits, chosen, scores[0].held_out, fixed):
        fits = _fits(task, models, start, T, whole.spacing, fixed, shaped=False)
        chosen, scores = _choose(task, fits)
    done = result_of(task, boards, labels, names, fits[chosen], whole, scores)
    # before a smooth correction, which has many more parameters and settles nothing that a plain lens leaves open
    _check_plausible(done)
    if model == "splined" or (model == "auto" and mean_residuals(done).share > SYSTEMATIC):
        better = _splined(task, fits[chosen], scores[0], whole.spacing, requested=model == "splined")
        if better is not None:
            done = result_of(task, boards, labels, names, better[0], whole, (better[1], *scores))
            _check_plausible(done)
    return done


def check_arguments(boards: Sequence[Board], names: Sequence[str] | None, model: str, size: Size | None) -> None:
    """Raise ConfigError for invalid arguments of `calibrate`, CalibrationError if there are no boards."""
    check_boards(boards)
    check_model(model)
    if names is not None and (given := len(texts(names, "names"))) != len(boards):
        raise ConfigError(f"names must have one entry a board: {len(boards)}, not {given}")
    given_size(size)
    if not boards:
        raise CalibrationError(
            "no boards: nothing to calibrate from; see what `rcdn detect --overlay` draws, in Python what "
            "Detector.detect gives of a picture"
        )


def check_model(model: str) -> None:
    """Raise ConfigError for a name that is no lens model's."""
    if model not in MODELS:
        raise ConfigError(f"model must be one of {', '.join(MODELS)}, not {shown(model)}")


def names_of(boards: Sequence[Board], names: Sequence[str] | None) -> list[str]:
    """The names of the boards' pictures; without `names` each board counts as a picture of its own."""
    return [f"board {k}" for k in range(len(boards))] if names is None else texts(names, "names")


def check_fix(fix: Collection[str]) -> frozenset[str]:
    """`fix` as a set. Raises ConfigError for a name that cannot be held fixed."""
    names = frozenset(texts(fix, "fix"))
    if unknown := sorted(names - set(FIXABLE)):
        raise ConfigError(f"fix may hold {' and '.join(FIXABLE)}, not {', '.join(map(repr, unknown))}")
    return names


def _fits(
    task: Usable, models: Sequence[str], start: Camera, T: Array, spacing: float, fixed: frozenset[str], shaped: bool
) -> dict[str, robust.Fit]:
    """Fits of those models whose initial fit leaves a scatter close to the least; the others do not describe this
    lens."""
    rough = {}
    for m in models:
        state = State.mono(Camera(start.K, np.zeros(LENSES[m][1]), start.image_size, LENSES[m][0]), T)
        state = with_fixed(state, fixed)
        rough[m] = robust.initial_fit(state, task.corners, task.sigma, default_free(state))
    median_sigma = float(np.median(task.sigma))
    scatter = {m: float(np.hypot(noise, median_sigma)) for m, (_, noise) in rough.items()}
    near = {m: found for m, found in rough.items() if scatter[m] <= HOPELESS_MODEL * min(scatter.values())}
    cluster = alike(task.corners, start.image_size, pictures_of(task))
    fits = {}
    for m, (state, noise) in near.items():
        state = with_fixed(replace(state, shape=np.zeros((len(FUNCTIONS) if shaped else 0, 3)), prior=None), fixed)
        free = default_free(state, shape=shaped)
        fits[m] = robust.fit(state, noise, task.corners, task.sigma, free, cluster, spacing)
    return fits


def pictures_of(task: Usable) -> Real[Array, " f"]:
    """(F,) picture number of each view."""
    first = np.unique(task.corners.frame, return_index=True)[1]
    return np.asarray(task.picture[first])


def _choose(task: Usable, fits: dict[str, robust.Fit]) -> tuple[str, tuple[ModelScore, ...]]:
    """The selected model and the scores of all, the selected one first. All are compared on the same corners: those of
    the model that leaves out the fewest."""
    common = _common(task, fits)
    free = [default_free(f.state, shape=True) for f in fits.values()]
    at, scores = choose.compare({m: f.state for m, f in fits.items()}, common, free)
    scores.insert(0, scores.pop(at))
    return scores[0].model, tuple(scores)


def _common(task: Usable, fits: dict[str, robust.Fit]) -> choose.Task:
    """The corners on which the `fits` are compared."""
    widest = max(fits.values(), key=lambda f: (int(f.used.sum()), -f.noise))
    return choose.Task(task.corners, widest.weight, task.picture)


def _flat_predicts_better(
    task: Usable, fits: dict[str, robust.Fit], chosen: str, held: float, fixed: frozenset[str]
) -> bool:
    """`choose.flat_predicts_better` for the `chosen` fit, with the held-out error `held`."""
    flat = with_fixed(replace(fits[chosen].state, shape=np.zeros((0, 3)), prior=None), fixed)
    return choose.flat_predicts_better(flat, held, _common(task, fits), default_free(flat, shape=True))


def _splined(
    task: Usable, fit: robust.Fit, score: ModelScore, spacing: float, requested: bool
) -> tuple[robust.Fit, ModelScore] | None:
    """The fit with a smooth correction of its lens, and its score; None if it does not reduce the held-out error
    (unless `requested` by the user), or if the corrected projection folds."""
    state = smooth_lens.fitted(fit.state, task.corners, fit.weight)
    if folds(state.cameras[0]):
        return None
    cluster = alike(task.corners, state.cameras[0].image_size, pictures_of(task))
    found = robust.fit(state, fit.noise, task.corners, task.sigma, default_free(state, shape=True), cluster, spacing)
    common = choose.Task(task.corners, fit.weight, task.picture)
    held = choose.held_out_rms(found.state, common, default_free(state, shape=True))
    if not requested and not held * choose.SIMPLER <= score.held_out:
        return None
    own = choose.rms(found.residuals, fit.weight)
    return found, ModelScore(f"{score.model} with spline", own, held)


def result_of(
    task: Usable,
    boards: Sequence[Board],
    labels: list[Labelled],
    names: Sequence[str],
    fit: robust.Fit,
    whole: Geometry,
    scores: tuple[ModelScore, ...],
    fewest: int = FEWEST_VIEWS,
) -> Calibration:
    """The calibration that a fit is; what it held fixed has no deviation.
    Raises CalibrationError if fewer views than `fewest` agree."""
    used = [f for f, reason in enumerate(fit.reasons) if not reason]
    if len(used) < fewest:
        raise CalibrationError(
            too_few(len(used), {f: fit.reasons[f] for f in range(len(fit.reasons)) if fit.reasons[f]})
        )
    camera = fit.state.cameras[0]
    cov = with_held(covariance(fit.arrow, np.array(used), fit.scale, fit.clustered), fit.free)
    lens = [*range(len(camera.parameters)), *range(len(cov) - 6, len(cov))]
    return Calibration(
        camera=camera,
        spacing=whole.spacing,
        views=_views(task, boards, labels, names, fit),
        cov=cov[np.ix_(lens, lens)],
        noise=fit.noise,
        models=scores,
        size=whole.size,
        orientation=whole.orientation,
        shape=None
        if whole.size is None or not len(fit.state.shape)
        else board_shape(fit.state.shape, whole.size, whole.plane),
        target=whole.target,
    )


def _views(
    task: Usable, boards: Sequence[Board], labels: list[Labelled], names: Sequence[str], fit: robust.Fit
) -> tuple[BoardView, ...]:
    number = {k: f for f, k in enumerate(task.index)}
    turn: Counter[str] = Counter()
    views = []
    for k, (board, label, name) in enumerate(zip(boards, labels, names, strict=True)):
        f = number.get(k)
        if f is None:
            view = board_view(board, label, name, turn[name], reason=task.reasons[k])
        else:
            mine, pose = task.corners.frame == f, Pose(fit.state.poses[f])
            view = board_view(board, label, name, turn[name], pose, fit.residuals[mine], fit.used[mine], fit.reasons[f])
        views.append(view)
        turn[name] += 1
    return tuple(views)


def _check_different(task: Usable, image_size: tuple[int, int]) -> None:
    """Raise CalibrationError, before the long computation, if all views show the board in one place."""
    views = len(task.seen)
    if views > 1 and not alike(task.corners, image_size, np.arange(views)).any():
        raise CalibrationError(
            f"these {views} views all show the board in the same place, which settles no camera; {DIFFERENT_VIEWS}"
        )


def _check_plausible(done: Calibration) -> None:
    """Raise CalibrationError if the views do not determine the focal length."""
    share = float(max(done.std[:2] / done.camera.parameters[:2]))
    if not np.isfinite(done.std).all() or share > HOPELESS or min(done.camera.parameters[:2]) <= 0:
        raise CalibrationError(
            f"these {len(done.used_views)} views don't settle the focal length (±{share:.0%}): they are too much "
            f"alike; {DIFFERENT_VIEWS}"
        )
