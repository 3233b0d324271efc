"""Boards → camera: the whole way, for one camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import choose, robust
from rcdn.calibration.advice import judged
from rcdn.calibration.bundle import Corners3, State, default_free, with_fixed
from rcdn.calibration.cut import whole_size
from rcdn.calibration.groups import describe
from rcdn.calibration.labels import Labelled, Size, in_line, mirrored, orientation_of, settle
from rcdn.calibration.shape import FUNCTIONS, board_shape, shape_basis
from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.calibration.uncertainty import covariance
from rcdn.calibration.views import alike
from rcdn.errors import CalibrationError, ConfigError
from rcdn.types import (
    Array,
    Board,
    BoardView,
    Calibration,
    Camera,
    CameraModel,
    ModelScore,
    Pose,
    plane_points,
)

LENSES: dict[str, tuple[CameraModel, int]] = {
    "pinhole": ("pinhole", 0),
    "radtan": ("brown", 4),
    "brown": ("brown", 5),
    "fisheye": ("fisheye", 4),
    "rational": ("rational", 8),
}
"""name → model and how many numbers its distortion has, the simplest first"""
AUTO = ("pinhole", "brown", "fisheye", "rational")
"""what `auto` compares"""
MODELS = ("auto", *LENSES)
FIXABLE = ("aspect", "principal_point")
"""what may be held fixed: fx = fy; the principal point in the middle of the picture"""
FEWEST_CORNERS, FEWEST_VIEWS = 6, 3
FEWEST_SHAPED = 5
"""views of the whole board, below which it is taken as perfect"""
LOOSEST = 1e3
"""px; a sigma beyond counts as this"""
SAME_SIZE = 0.75
"""share of the boards whose pictures have one size: the others are left out, or it would be an error"""
HOPELESS_MODEL = 2.0
"""× the least scatter that a model leaves: beyond it a model isn't tried any further"""
HOPELESS = 0.2
"""standard deviation of the focal length, as a share of it, that is no calibration"""


def calibrate(
    boards: Sequence[Board],
    spacing: float,
    *,
    names: Sequence[str] | None = None,
    model: str = "auto",
    size: Size | None = None,
    flat: bool = False,
    fix: Collection[str] = (),
    leave_out: Sequence[str] = (),
) -> Calibration:
    """The camera that took `boards`, with poses, residuals and standard deviations.

    `boards`: what `Detector.boards` gives, partial boards and several a picture too, all of one camera at one zoom. `spacing`: side of
    a square (of a deltille: of a triangle), m. `names` of the boards' pictures: boards of one name are held out together (default: each
    board its own). `model`: `pinhole` (no distortion), `radtan` (k1 k2 p1 p2), `brown` (with k3), `fisheye` (Kannala–Brandt, 4),
    `rational` (8), or `auto`: the simplest that does nearly as well as the best on pictures held out. `size` (columns, rows) of the board
    in inner corners; default: the usual one of the complete boards that the picture's border can't have cut. `flat`: the board is known to be
    perfect, a glass one, say; by default its shape is solved for, too, where five views settle which corner is which (`rcdn.calibration.shape`).
    `fix`: what is held fixed, `aspect` (fx = fy), `principal_point` (the middle of the picture), or both.
    `leave_out`: names of pictures that the camera shall not rest on, or `name:2` for the second board of one; they stay among the views.

    Each corner weighs by its sigma and the scatter beyond it that the corners show. Corners and views that disagree with the others are left
    out and named. Covariances are by the scatter of whole views (`rcdn.calibration.uncertainty.clustered`), views alike counting as one.
    Raises CalibrationError if the boards can't settle a camera, ConfigError for a wrong argument.
    """
    _check(boards, spacing, names, model, size)
    fixed = check_fix(fix)
    names = [f"board {k}" for k in range(len(boards))] if names is None else list(names)
    if leave_out:
        from rcdn.calibration.by_hand import without  # which rests on this module

        return without(
            lambda some, named: calibrate(some, spacing, names=named, model=model, size=size, flat=flat, fix=fix),
            boards,
            names,
            leave_out,
        )
    image_size = _one_size(boards, names)
    whole = size or whole_size(boards)
    labels = settle(boards, whole, strict=size is not None)
    task = _task(boards, labels, names, image_size, spacing, whole)
    start = first_camera(task.seen, image_size)
    task, T = _with_poses(task, poses(start, task.seen))
    models = AUTO if model == "auto" else (model,)
    fits = _fits(task, models, start, T, spacing, fixed, shaped=not flat and task.settled >= FEWEST_SHAPED)
    chosen, scores = _choose(task, fits)
    done = _result(task, boards, labels, names, fits[chosen], whole, scores, spacing)
    _believable(done)
    return judged(done)


@dataclass(frozen=True, eq=False)
class _Task:
    """The boards that can be used: `index` of each among all, what is `seen`, `reasons` by index of those that can't; `corners`, `sigma` (N,),
    `picture` (N,) its number; `settled`: how many views show which corner of the board is which."""

    index: list[int]
    seen: list[Seen]
    reasons: dict[int, str]
    corners: Corners3
    sigma: Array
    picture: Array
    settled: int


def _check(boards: Sequence[Board], spacing: float, names: Sequence[str] | None, model: str, size: Size | None) -> None:
    check_spacing(spacing)
    if model not in MODELS:
        raise ConfigError(f"model must be one of {', '.join(MODELS)}, not {model!r}")
    if names is not None and len(names) != len(boards):
        raise ConfigError(f"names must have one entry a board: {len(boards)}, not {len(names)}")
    if size is not None and min(size) < 2:
        raise ConfigError(f"size counts inner corners (columns, rows), at least 2 each, not {tuple(size)}")
    if len({board.pattern for board in boards}) > 1:
        raise ConfigError("boards: some are of squares and some of triangles (deltilles); calibrate from one kind")
    for k, board in enumerate(boards):
        if not np.isfinite(board.xy).all():
            raise ConfigError(f"boards[{k}].xy must be finite; leave out corners that have no position")
    if not boards:
        raise CalibrationError("no boards: nothing to calibrate from; see what `rcdn detect --overlay` draws")


def check_fix(fix: Collection[str]) -> frozenset[str]:
    """`fix` as a set. Raises ConfigError for what can't be held fixed."""
    names = frozenset([fix] if isinstance(fix, str) else fix)
    if unknown := sorted(names - set(FIXABLE)):
        raise ConfigError(f"fix may hold {' and '.join(FIXABLE)}, not {', '.join(map(repr, unknown))}")
    return names


def _one_size(boards: Sequence[Board], names: Sequence[str]) -> tuple[int, int]:
    """The image size of (nearly) all boards, or an error that says which pictures are odd."""
    sizes = Counter(b.image_size for b in boards)
    (usual, many), *_ = sizes.most_common(1)
    if many >= SAME_SIZE * len(boards):
        return usual
    raise CalibrationError(
        f"pictures of several sizes ({_by_size(boards, names, sizes)}): one calibration is of one camera at one resolution; "
        "calibrate the pictures of each size by themselves"
    )


def _by_size(boards: Sequence[Board], names: Sequence[str], sizes: Counter[tuple[int, int]]) -> str:
    """Each size with the pictures that have it."""
    texts = []
    for size, many in sizes.most_common():
        mine = [n for n, b in zip(names, boards, strict=True) if b.image_size == size]
        rest = [n for n, b in zip(names, boards, strict=True) if b.image_size != size]
        texts.append(f"{size[0]}×{size[1]} in {many}: {describe(mine, rest)}")
    return "; ".join(texts)


def _unusable(board: Board, label: Labelled, image_size: tuple[int, int]) -> str:
    """Why a board can't take part, or ""."""
    if board.image_size != image_size:
        (w, h), (cols, rows) = board.image_size, image_size
        return f"its picture has {w}×{h} px, the others {cols}×{rows}"
    if label.reason:
        return label.reason
    if len(board) < FEWEST_CORNERS or min(board.size) < 2:
        return f"it has only {len(board)} corners in {board.size[0]}×{board.size[1]}"
    if in_line(board):
        return "its corners lie in one line"
    return (
        "its labels run the wrong way round: were pixels mirrored after the corners were found?"
        if mirrored(board)
        else ""
    )


def _task(
    boards: Sequence[Board],
    labels: list[Labelled],
    names: Sequence[str],
    image_size: tuple[int, int],
    spacing: float,
    whole: Size | None,
) -> _Task:
    """Boards with corners enough."""
    numbers = {name: k for k, name in enumerate(dict.fromkeys(names))}
    index, reasons = [], {}
    for k, (board, label) in enumerate(zip(boards, labels, strict=True)):
        if reason := _unusable(board, label, image_size):
            reasons[k] = reason
        else:
            index.append(k)
    if len(index) < FEWEST_VIEWS:
        raise CalibrationError(_too_few(len(index), reasons))
    ij = [labels[k].ij for k in index]
    lengths = [len(a) for a in ij]
    frame = np.repeat(np.arange(len(index)), lengths)
    joint = np.concatenate(ij)
    sigma = np.concatenate([sigma_of(boards[k]) for k in index])
    corners = Corners3(
        frame,
        np.zeros(len(frame), int),
        plane_points(joint, boards[0].pattern) * spacing,
        np.concatenate([boards[k].xy for k in index]),
        _basis([labels[k] for k in index], whole),
    )
    picture = np.repeat([numbers[names[k]] for k in index], lengths)
    seen = [Seen(plane_points(a, boards[k].pattern) * spacing, boards[k].xy) for k, a in zip(index, ij, strict=True)]
    settled = sum(labels[k].settled for k in index)
    return _Task(index, seen, reasons, corners, np.nan_to_num(sigma), picture, settled)


def _basis(labels: list[Labelled], whole: Size | None) -> Array:
    """(N, B) functions of the board's shape at the corners; 0 in views that don't settle which corner is which."""
    parts = [
        shape_basis(label.ij, whole) if label.settled and whole else np.zeros((len(label.ij), len(FUNCTIONS)))
        for label in labels
    ]
    return np.concatenate(parts)


def _too_few(many: int, reasons: dict[int, str]) -> str:
    got = "one view" if many == 1 else f"{many} views" if many else "no view that can be used"
    why = f"; {len(reasons)} more can't be used: {next(iter(reasons.values()))}" if reasons else ""
    verb = "are" if many > 1 else "is"
    return (
        f"there {verb} {got}{why}. A camera takes {FEWEST_VIEWS} at least, and to be trusted 10 to 30 pictures of the board in different "
        "places and tilts"
    )


def check_spacing(spacing: float) -> None:
    """Raise ConfigError unless `spacing` can be the side of a square."""
    if not (np.isfinite(spacing) and spacing > 0):
        raise ConfigError(
            f"spacing is the side of one square in metres and must be positive (25 mm: 0.025), not {spacing}"
        )


def sigma_of(board: Board) -> Array:
    """(M,) px; NaN where unknown."""
    return np.full(len(board), np.nan) if board.sigma is None else np.minimum(board.sigma, LOOSEST)


def _with_poses(task: _Task, T: Array) -> tuple[_Task, Array]:
    """Only the views that got a pose."""
    good = np.asarray(np.isfinite(T).all(axis=(1, 2)))
    if good.all():
        return task, T
    if good.sum() < FEWEST_VIEWS:
        raise CalibrationError(_too_few(int(good.sum()), {k: "no pose fits its corners" for k in task.index}))
    keep = good[task.corners.frame]
    number = np.cumsum(good) - 1
    corners = task.corners.take(keep)
    corners = replace(corners, frame=number[corners.frame])
    reasons = task.reasons | {k: "no pose fits its corners" for k, g in zip(task.index, good, strict=True) if not g}
    index = [k for k, g in zip(task.index, good, strict=True) if g]
    seen = [s for s, g in zip(task.seen, good, strict=True) if g]
    return _Task(index, seen, reasons, corners, task.sigma[keep], task.picture[keep], task.settled), T[good]


def _fits(
    task: _Task, models: Sequence[str], start: Camera, T: Array, spacing: float, fixed: frozenset[str], shaped: bool
) -> dict[str, robust.Fit]:
    """Fits of the models that come near the best; the others are no lens for these corners."""
    rough = {}
    for m in models:
        state = State.mono(Camera(start.K, np.zeros(LENSES[m][1]), start.image_size, LENSES[m][0]), T)
        state = with_fixed(state, fixed)
        rough[m] = robust.rough_fit(state, task.corners, task.sigma, default_free(state))
    usual = float(np.median(task.sigma))
    scatter = {m: float(np.hypot(noise, usual)) for m, (_, noise) in rough.items()}
    near = {m: found for m, found in rough.items() if scatter[m] <= HOPELESS_MODEL * min(scatter.values())}
    cluster = alike(task.corners, start.image_size, _pictures(task))
    fits = {}
    for m, (state, noise) in near.items():
        state = with_fixed(replace(state, shape=np.zeros((len(FUNCTIONS) if shaped else 0, 3)), prior=None), fixed)
        free = default_free(state, shape=shaped)
        fits[m] = robust.fit(state, noise, task.corners, task.sigma, free, cluster, spacing)
    return fits


def _pictures(task: _Task) -> Array:
    """(F,) the number of each view's picture."""
    first = np.unique(task.corners.frame, return_index=True)[1]
    return np.asarray(task.picture[first])


def _choose(task: _Task, fits: dict[str, robust.Fit]) -> tuple[str, tuple[ModelScore, ...]]:
    """The model to take and how all did, that one first: on the same corners, those of the model that leaves out least."""
    widest = max(fits.values(), key=lambda f: (int(f.used.sum()), -f.noise))
    common = choose.Task(task.corners, widest.weight, task.picture)
    free = [default_free(f.state, shape=True) for f in fits.values()]
    at, trials = choose.compare([f.state for f in fits.values()], common, free)
    scores = [ModelScore(m, t.rms, t.held) for m, t in zip(fits, trials, strict=True)]
    scores.insert(0, scores.pop(at))
    return scores[0].model, tuple(scores)


def _result(
    task: _Task,
    boards: Sequence[Board],
    labels: list[Labelled],
    names: Sequence[str],
    fit: robust.Fit,
    whole: Size | None,
    scores: tuple[ModelScore, ...],
    spacing: float,
) -> Calibration:
    used = [f for f, reason in enumerate(fit.reasons) if not reason]
    if len(used) < FEWEST_VIEWS:
        raise CalibrationError(
            _too_few(len(used), {f: fit.reasons[f] for f in range(len(fit.reasons)) if fit.reasons[f]})
        )
    cov = covariance(fit.arrow, np.array(used), fit.scale, fit.clustered)
    camera = fit.state.cameras[0]
    lens = [*range(len(camera.parameters)), *range(len(cov) - 6, len(cov))]
    return Calibration(
        camera=camera,
        spacing=float(spacing),
        views=_views(task, boards, labels, names, fit),
        cov=cov[np.ix_(lens, lens)],
        noise=fit.noise,
        models=scores,
        size=whole,
        orientation=None if whole is None else orientation_of(whole),
        shape=None if whole is None or not len(fit.state.shape) else board_shape(fit.state.shape, whole),
    )


def _views(
    task: _Task, boards: Sequence[Board], labels: list[Labelled], names: Sequence[str], fit: robust.Fit
) -> tuple[BoardView, ...]:
    number = {k: f for f, k in enumerate(task.index)}
    turn: Counter[str] = Counter()
    views = []
    for k, (board, label, name) in enumerate(zip(boards, labels, names, strict=True)):
        f = number.get(k)
        mine = task.corners.frame == f if f is not None else np.zeros(0, bool)
        views.append(
            BoardView(
                name=name,
                board=turn[name],
                ij=label.ij,
                xy=board.xy,
                sigma=sigma_of(board),
                pose=None if f is None else Pose(fit.state.poses[f]),
                residuals=np.full((len(board), 2), np.nan) if f is None else fit.residuals[mine],
                used=np.zeros(len(board), bool) if f is None else fit.used[mine],
                reason=task.reasons[k] if f is None else fit.reasons[f],
                settled=label.settled,
            )
        )
        turn[name] += 1
    return tuple(views)


def _believable(done: Calibration) -> None:
    """Refuse what is no calibration: a focal length that the views don't settle."""
    share = float(max(done.std[:2] / done.camera.parameters[:2]))
    if not np.isfinite(done.std).all() or share > HOPELESS or min(done.camera.parameters[:2]) <= 0:
        raise CalibrationError(
            f"these {len(done.used_views)} views don't settle the focal length (±{share:.0%}): they are too much alike; "
            "take pictures of the board tilted by 30° to 45°, to different sides, and near and far"
        )
