"""One lens model for two cameras of the same make: the simplest that predicts the held-out pictures of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration import choose
from rcdn.calibration.board_points import flat_points
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.calibrate import AUTO
from rcdn.calibration.relative_pose import matrix
from rcdn.calibration.sight import off_axis, reach
from rcdn.calibration.solver import solve
from rcdn.errors import CalibrationError
from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

Both = tuple[Calibration, Calibration]
ALIKE = 0.05
"""relative difference of the angles of two lenses up to which they are alike, at the radius that corners reach from the
axis and at half of it"""
PERHAPS = 0.25
"""the same for lenses that may be alike although a wrong model distorts the angles of one of them"""
REACHED = 90
"""percentile of the corners' distances from the principal point up to which two lenses are compared"""
ENOUGH = 6
"""least number of pictures with which a camera keeps a model of its own; with fewer it takes that of the other
camera"""
WORSE = 1.5
"""× a camera's least held-out error, under whichever model: one with a larger error does not describe that camera"""


def one_model(
    found: Both, calibrate_as: Callable[[int, str], Calibration], pairs: Sequence[tuple[int, int]]
) -> tuple[Calibration, Calibration, str]:
    """The calibrations of two similar cameras under one lens model, and a sentence about it; `found` itself and "" for
    cameras that differ.

    `found`: the result of each camera alone with `auto`. `calibrate_as(side, model)` calibrates the left (0) or the
    right (1) camera with a given model. `pairs`: (index of the left view, index of the right view) taken at one moment:
    both are held out together.

    The cameras are similar if their picture sizes are equal and their pixels have the same angles from the axis
    (`alike`), under their own models or under a common one. The candidates range from the simpler to the more complex
    of both choices; selected is the simplest whose error in held-out pictures of both cameras, over all corners, is
    close to the least (the rule of `choose.compare`). A camera with few pictures takes the model of the other. A model
    that predicts the pictures of one camera far worse than another does, or has no rays in a part of its frame, is
    excluded; if none remains, both cameras keep their own.
    """
    names = [c.models[0].model for c in found]
    if names[0] == names[1] or not set(names) <= set(AUTO) or not alike(*found, PERHAPS):
        return *found, ""
    least, most = sorted(AUTO.index(name) for name in names)
    candidates = _candidates(found, AUTO[least : most + 1], calibrate_as)
    if not any(alike(*both) for both in (found, *candidates.values())):
        return *found, ""
    left_few, right_few = (len({v.name for v in c.used_views}) < ENOUGH for c in found)
    given = "" if left_few == right_few else names[1] if left_few else names[0]
    common = _common(candidates, pairs, given)
    if not common:
        return *found, _apart(names)
    left, right = (_with_scores(c, of) for c, of in zip(candidates[common], found, strict=True))
    return left, right, _together(common, names)


def alike(first: Calibration, second: Calibration, within: float = ALIKE) -> bool:
    """Whether two cameras have pictures of equal size and equal angles from the axis, up to the relative difference
    `within`."""
    if first.camera.image_size != second.camera.image_size:
        return False
    radius = min(_reached(c) for c in (first, second))
    turn = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    ring = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    offsets = np.stack([ring / 2, ring])
    angles = [off_axis(c.camera, c.camera.K[:2, 2] + offsets).mean(axis=1) for c in (first, second)]
    return bool((np.abs(angles[0] - angles[1]) <= within * angles[1]).all())


def _reached(calibration: Calibration) -> float:
    """Radius around the principal point that the corners reach, px."""
    xy = np.concatenate([v.xy[v.used] for v in calibration.used_views])
    return float(np.percentile(np.linalg.norm(xy - calibration.camera.K[:2, 2], axis=1), REACHED))


def _candidates(found: Both, models: Sequence[str], calibrate_as: Callable[[int, str], Calibration]) -> dict[str, Both]:
    """Both cameras under each of the models, the simplest first; without models under which one of the cameras cannot
    be calibrated."""
    candidates: dict[str, Both] = {}
    for model in models:
        try:
            left, right = (
                c if c.models[0].model == model else calibrate_as(side, model) for side, c in enumerate(found)
            )
        except CalibrationError:
            continue
        candidates[model] = (left, right)
    return candidates


def _common(candidates: dict[str, Both], pairs: Sequence[tuple[int, int]], given: str) -> str:
    """The model for both cameras: `given` unless that is ""; "" if no model is suitable for both."""
    if not candidates:
        return ""
    held = _held_out(list(candidates.values()), pairs)
    reaches = np.array([[reach(c.camera) for c in both] for both in candidates.values()])
    whole = reaches >= reaches.max(axis=0) - choose.LOST
    least = np.where(np.isnan(held[:, :2]), np.inf, held[:, :2]).min(axis=0)
    fair = whole.all(axis=1) & ~(held[:, :2] > WORSE * least).any(axis=1)
    names = [m for m, f in zip(candidates, fair, strict=True) if f and given in ("", m)]
    if given or not names:
        return names[0] if names else ""
    pooled = held[fair, 2]
    if np.isnan(pooled).all():  # too few pictures
        return "brown" if "brown" in names else names[0]
    return names[int(np.flatnonzero(pooled <= choose.SIMPLER * np.nanmin(pooled))[0])]


def _held_out(models: list[Both], pairs: Sequence[tuple[int, int]]) -> Real[Array, "m 3"]:
    """(M, 3) RMS error in held-out pictures under each model, px: of the left camera, of the right one, of both."""
    task, starts = _joint(models, pairs)
    cameras = [(0,), (1,), (0, 1)]
    weights = [np.where(np.isin(task.corners.camera, c), task.weight, 0) for c in cameras]
    scores = []
    for start in starts:
        free = default_free(start)
        gaps = choose.held_out(solve(start, task.corners, task.weight, free).state, task, free)
        scores.append([choose.rms(gaps, weight) for weight in weights])
    return np.array(scores)


@dataclass(frozen=True, eq=False)
class _Seen:
    """The part of the joint problem that one camera contributes: `views` (their indices) with all `corners`, their
    `weight`, and the `picture` of each corner."""

    views: list[int]
    corners: Corners3
    weight: Array
    picture: Array


def _joint(candidates: list[Both], pairs: Sequence[tuple[int, int]]) -> tuple[choose.Task, list[State]]:
    """Corners of both cameras, each view with its own pose, and the initial state of each model.

    All models are compared on the same corners: for each camera those of the candidate that leaves out the fewest.
    """
    pictures = _pictures(candidates[0], pairs)
    left = _seen([c[0] for c in candidates], 0, 0, pictures[0])
    right = _seen([c[1] for c in candidates], 1, len(left.views), pictures[1])
    corners = Corners3(*(np.concatenate(parts) for parts in zip(*map(_arrays, (left, right)), strict=True)))
    weight, picture = (np.concatenate([getattr(s, k) for s in (left, right)]) for k in ("weight", "picture"))
    starts = []
    for both in candidates:
        views = [c.views[k] for c, s in zip(both, (left, right), strict=True) for k in s.views]
        poses = np.array([matrix(v) for v in views])
        starts.append(State((both[0].camera, both[1].camera), poses, np.stack([np.eye(4)] * 2)))
    return choose.Task(corners, weight, picture), starts


def _arrays(seen: _Seen) -> tuple[Array, ...]:
    c = seen.corners
    return c.frame, c.camera, c.board, c.xy, c.basis


def _seen(models: list[Calibration], camera: int, at: int, pictures: list[int]) -> _Seen:
    """The contribution of one camera, calibrated with each of the models; frames are numbered from `at`."""
    widest = max(models, key=lambda c: sum(int(v.used.sum()) for v in c.used_views))
    views = [
        k
        for k, v in enumerate(widest.views)
        if not v.reason and v.used.any() and all(c.views[k].pose is not None for c in models)
    ]
    chosen = [widest.views[k] for k in views]
    lengths = [len(v) for v in chosen]
    frame = np.repeat(at + np.arange(len(views)), lengths)
    xy, sigma = (np.concatenate([getattr(v, key) for v in chosen]) for key in ("xy", "sigma"))
    board = np.concatenate([flat_points(widest, v) for v in chosen])
    corners = Corners3(frame, np.full(len(frame), camera), board, xy, np.zeros((len(frame), 0)))
    used = np.concatenate([v.used for v in chosen])
    weight = used / np.hypot(max(widest.noise, 1e-4), np.nan_to_num(sigma))
    return _Seen(views, corners, weight, np.repeat([pictures[k] for k in views], lengths))


def _pictures(both: Both, pairs: Sequence[tuple[int, int]]) -> tuple[list[int], list[int]]:
    """A picture number for each view; the pictures of a pair share one number, so that they are held out together."""
    left, right = both
    partner = {right.views[b].name: left.views[a].name for a, b in pairs}
    keys = [("left", v.name) for v in left.views]
    keys += [("left", partner[v.name]) if v.name in partner else ("right", v.name) for v in right.views]
    number = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    numbers = [number[key] for key in keys]
    return numbers[: len(left.views)], numbers[len(left.views) :]


def _with_scores(chosen: Calibration, alone: Calibration) -> Calibration:
    """`chosen` with the scores of all models that were tried, its own first."""
    mine = chosen.models[0]
    tried = next((m for m in alone.models if m.model == mine.model and np.isfinite(m.held_out)), mine)
    return replace(chosen, models=(tried, *(m for m in alone.models if m.model != mine.model)))


def _together(model: str, alone: Sequence[str]) -> str:
    sides = zip(("left", "right"), alone, strict=True)
    other = " and ".join(f"{name} on the {side}" for side, name in sides if name != model)
    return (
        f"The lenses are alike, so both cameras have one model, {model}, the simplest that predicts the pictures of "
        f"both (each alone: {other})."
    )


def _apart(alone: Sequence[str]) -> str:
    return (
        f"The lenses see at the same angles, but no one model does for both: {alone[0]} on the left, {alone[1]} on the "
        "right. If they are of one make, take more pictures with the board near the frame's edges, or name a model."
    )
