"""Calibration of two cameras that see the same boards: their relative pose, and rectification of their images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import index

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.arguments import check_boards, check_own_boards, given_size
from rcdn.calibration.calibrate import check_arguments, check_model
from rcdn.calibration.coded import Geometries, Spacing
from rcdn.calibration.common_model import one_model
from rcdn.calibration.epipolar import epipolar_gaps, matches
from rcdn.calibration.joint_pairs import JointPairs
from rcdn.calibration.known_lens import with_lens
from rcdn.calibration.labels import Size
from rcdn.calibration.one_thread import one_thread
from rcdn.calibration.relative_pose import FEWEST_PAIRS, determines_pose, hypotheses, place
from rcdn.calibration.rig_fit import fitted
from rcdn.calibration.rig_solution import RigSolution
from rcdn.calibration.rig_start import Key
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.stereo_verdict import judged_stereo
from rcdn.errors import CalibrationError, ConfigError, many, said_of, shown
from rcdn.geometry.rectification import rectifying
from rcdn.types import Array, Board, Calibration, Camera, StereoCalibration
from rcdn.types.calibration import SIDES

Names = tuple[Sequence[str], Sequence[str]]
KnownLenses = tuple[Camera | None, Camera | None]
"""the left and the right camera whose lens is known, None where it is solved for"""


@one_thread()
def calibrate_stereo(
    left: Sequence[Board],
    right: Sequence[Board],
    spacing: Spacing,
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    names: Names | None = None,
    model: str = "auto",
    size: Size | None = None,
    cameras: KnownLenses = (None, None),
) -> StereoCalibration:
    """Calibrate both cameras and the pose of the right one relative to the left, from boards that both saw at the same
    moment.

    `left`, `right`: the cameras' boards, including partial ones and boards that only one camera saw (they help its
    lens). `pairs`: (index in `left`, index in `right`) of the same board at the same moment; default: equal indices.
    Only boards whose place on the whole board is known (settled labels) determine the relative pose; for a symmetric
    board, the turn that agrees with the other pairs is taken. `names` of the images. `cameras`: (left, right) of known
    lenses, which are held constant (as OpenCV's CALIB_FIX_INTRINSIC); None: that lens is solved for. All else as in
    `calibrate`.

    Starts from each camera's own calibration, then estimates lenses, board poses, the board's shape and the relative
    pose jointly, as in `calibrate_rig`. Raises CalibrationError if the pairs do not agree on the relative pose, not
    even under lenses that are solved for jointly; it says so if mirrored images would explain it.
    """
    check_boards(left, "left")
    check_boards(right, "right")
    found = stereo_solution(left, right, spacing, pairs=pairs, names=names, model=model, size=size, cameras=cameras)
    return found.stereo


@dataclass(frozen=True, eq=False)
class StereoSolution:
    """A stereo calibration; `cov` (P + 6, P + 6), the covariance of the lenses and the relative pose, P parameters, and
    of the boards' mean motion in the left camera, over `used` frames; `single` (P, P): that of the parameters from the
    noise of single corners, but for a factor."""

    stereo: StereoCalibration
    cov: Array
    single: Array
    used: int


def stereo_solution(
    left: Sequence[Board],
    right: Sequence[Board],
    spacing: Spacing,
    *,
    pairs: Sequence[tuple[int, int]] | None = None,
    names: Names | None = None,
    model: str = "auto",
    size: Size | None = None,
    cameras: KnownLenses = (None, None),
) -> StereoSolution:
    """`calibrate_stereo` with the covariance of both lenses and the relative pose together."""
    _check_names(names)
    pairs, size = _pairs(left, right, pairs), given_size(size)
    both = [left[a] for a, _ in pairs], [right[b] for _, b in pairs]
    check_own_boards(SIDES, both, [range(len(pairs))] * 2)
    _check_lenses(cameras, model)
    known = (cameras[0] is not None, cameras[1] is not None)
    lenses = (cameras[0] or model, cameras[1] or model)
    first, second, note = _each(left, right, spacing, pairs, names, lenses, size)
    shared = [p for p in pairs if determines_pose(first.views[p[0]], second.views[p[1]])]
    if len(shared) < FEWEST_PAIRS:
        some = many(len(shared), "pair shows", "pairs show")
        raise CalibrationError(
            f"only {some} the whole board to both cameras, {FEWEST_PAIRS} are the least: take 10 or more, "
            "and check that the pictures are given in the same order or with the same names"
        )
    T, turned, odd = _placed(first, second, shared, pairs, known)
    task = pair_task(first, second, [p for p in shared if p not in odd], turned, known)
    shaped = (first, second)[task.shape]
    start = task.start((first, second), {0: np.eye(4), 1: T})
    fit = fitted(task.joint, start, shaped=shaped.shape is not None, spacing=shaped.spacing)
    solution = RigSolution.of(task, fit)
    _check_pairs(solution)
    given = tuple(side for side, held in zip(SIDES, known, strict=True) if held)
    done = replace(_result(solution, first, second, odd), given=given)
    judged = judged_stereo(replace(done, advice=(*done.advice, note)) if note else done)
    end = solution.places.stop
    mine = [*range(end), *range(len(solution.cov) - 6, len(solution.cov))]
    single = fit.arrow.covariance[:end, :end]
    return StereoSolution(judged, solution.cov[np.ix_(mine, mine)], single, len(solution.used))


def _check_lenses(cameras: KnownLenses, model: str) -> None:
    """Raise ConfigError unless `cameras` are two, each a Camera or None, and there is a lens `model` of this name."""
    check_model(model)
    two = isinstance(cameras, (tuple, list)) and len(cameras) == 2
    if not two or not all(c is None or isinstance(c, Camera) for c in cameras):
        raise ConfigError(f"cameras must be (left, right), each a Camera or None, not {shown(cameras)}")


def _check_names(names: Names | None) -> None:
    """Raise ConfigError unless `names` are two, or None."""
    if names is not None and not (isinstance(names, (tuple, list)) and len(names) == 2):
        raise ConfigError(f"names must be (of the left pictures, of the right ones), not {shown(names)}")


def _each(
    left: Sequence[Board],
    right: Sequence[Board],
    spacing: Spacing,
    pairs: Sequence[tuple[int, int]],
    names: Names | None,
    lenses: tuple[str | Camera, str | Camera],
    size: Size | None,
) -> tuple[Calibration, Calibration, str]:
    """The calibration of each camera alone with its lens model or known lens, of one lens model where `auto` may choose
    and both see alike; and a note on that choice, or ""."""
    named = names or (None, None)
    of = _common(left, right, spacing, size, any(isinstance(lens, Camera) for lens in lenses)) or spacing
    first = _alone(0, left, of, named[0], lenses[0], size)
    whole = size if isinstance(of, Geometries) else size or first.size
    second = _alone(1, right, of, named[1], lenses[1], whole)
    if first.size != second.size:
        raise CalibrationError(
            f"the cameras saw different boards ({_text(first.size)} left, {_text(second.size)} right): "
            "name the size to use"
        )
    if lenses != ("auto", "auto"):
        return first, second, ""
    boards = (left, right)
    return one_model(
        (first, second), lambda side, name: _alone(side, boards[side], of, named[side], name, whole), pairs
    )


def _common(
    left: Sequence[Board], right: Sequence[Board], spacing: Spacing, size: Size | None, known: bool
) -> Geometries | None:
    """The targets that both cameras saw, so that a corner has the same label in both; None if no board's codes were
    read and no lens is `known`."""
    both = [*left, *right]
    return Geometries.of(both, spacing, size) if known or any(b.target is not None for b in both) else None


def _alone(
    side: int,
    boards: Sequence[Board],
    of: Spacing | Geometries,
    names: Sequence[str] | None,
    lens: str | Camera,
    size: Size | None,
) -> Calibration:
    """The calibration of the left (0) or the right (1) camera alone with a lens model or a known lens, from boards of a
    spacing or of known geometries; errors name the camera. If a `size` is given, other plain boards are refused."""
    with said_of(f"{SIDES[side]} camera", CalibrationError):
        if not isinstance(of, Geometries):
            check_arguments(boards, names, str(lens), size)
            of = Geometries.of(boards, of, size)
        return with_lens(boards, of, names, lens, size is not None)


def _text(size: Size | None) -> str:
    return "no whole one" if size is None else f"{size[0]}×{size[1]}"


def _pairs(
    left: Sequence[Board], right: Sequence[Board], pairs: Sequence[tuple[int, int]] | None
) -> Sequence[tuple[int, int]]:
    if pairs is None:
        if len(left) != len(right):
            raise ConfigError(
                f"left has {many(len(left), 'board')}, right {len(right)}: give pairs, or boards in pairs"
            )
        return [(k, k) for k in range(len(left))]
    try:
        pairs = [(index(a), index(b)) for a, b in pairs]
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"pairs must be a list of (index in left, index in right), whole numbers, not {shown(pairs)}"
        ) from error
    if any(not (0 <= a < len(left) and 0 <= b < len(right)) for a, b in pairs):
        raise ConfigError(
            f"pairs must hold (index in left, index in right), from 0 to {len(left) - 1} and {len(right) - 1}"
        )
    if any(len({p[side] for p in pairs}) < len(pairs) for side in (0, 1)):
        raise ConfigError("pairs must not hold an index of left or right twice")
    return pairs


def _placed(
    first: Calibration,
    second: Calibration,
    shared: list[tuple[int, int]],
    pairs: Sequence[tuple[int, int]],
    known: tuple[bool, bool],
) -> tuple[Array, dict[int, int], list[tuple[int, int]]]:
    """As `place`; if most of the `shared` pairs disagree by the views alone, the relative pose by which they agree
    under lenses that are solved for jointly (boards that both cameras see at the edges of their pictures only)."""
    try:
        return place(first, second, shared, pairs)
    except CalibrationError:
        sights: list[dict[Key, int]] = [{(str(k), 0): pair[c] for k, pair in enumerate(shared)} for c in (0, 1)]
        edge = JointPairs((first, second), sights, known).edge(0, 1)
        if edge is None:
            raise
    turns = hypotheses(first, second, shared).nearest(edge.T)[1]
    agree = [(str(k), 0) in edge.joint for k in range(len(shared))]
    turned = {b: int(q) for (_, b), q, fits in zip(shared, turns, agree, strict=True) if fits}
    return edge.T, turned, [pair for pair, fits in zip(shared, agree, strict=True) if not fits]


def pair_task(
    first: Calibration,
    second: Calibration,
    pairs: Sequence[tuple[int, int]],
    turned: Mapping[int, int],
    known: tuple[bool, bool] = (False, False),
) -> RigTask:
    """The joint problem of both calibrations as that of a rig of two: `pairs` of their views are of the same board at
    the same moment; `turned`: quarter turns of the right views' labels; `known`: whether each lens is held constant."""
    alone = (first, second)
    when = [[f"{'lr'[c]}{k}" for k in range(len(each.views))] for c, each in enumerate(alone)]
    for a, b in pairs:
        when[1][b] = when[0][a]
    sights: list[dict[Key, int]] = [{(when[c][pair[c]], 0): pair[c] for pair in pairs} for c in (0, 1)]
    turns = {key: turned[b] for key, b in sights[1].items()}
    return RigTask.of_two((0, 1), alone, sights, turns, when, known)


def _check_pairs(solution: RigSolution) -> None:
    """Raise CalibrationError if too few pairs agree."""
    pairs = [f for f in solution.used if solution.task.keys[f] is not None]
    if len(pairs) < FEWEST_PAIRS:
        raise CalibrationError(
            f"only {many(len(pairs), 'pair agrees', 'pairs agree')} with the others: "
            "check that pictures are paired by moment"
        )


def _result(
    solution: RigSolution, first: Calibration, second: Calibration, odd: list[tuple[int, int]]
) -> StereoCalibration:
    task, fit, T = solution.task, solution.fit, solution.fit.state.rig[1]
    left, right = solution.cameras((first, second), solution.rig(SIDES))
    left, right = (_paired(task, c, calibration) for c, calibration in enumerate((left, right)))
    rectified = rectifying(left.camera, right.camera, T)
    advice = _odd_pairs([f"{first.views[a].name} and {second.views[b].name}" for a, b in odd])
    cov = solution.cov[solution.places, solution.places]
    pairs = sum(key is not None for key in task.keys)
    return StereoCalibration(left, right, T, cov, solution.rms, _epipolar(task, fit), *rectified, advice, pairs=pairs)


def _odd_pairs(names: list[str]) -> tuple[str, ...]:
    """Advice that names the pairs that were left out."""
    if not names:
        return ()
    some = f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''}"
    those = many(len(names), "pair disagrees", "pairs disagree")
    left_out = "was left out" if len(names) == 1 else "were left out"
    return (f"{those} with the others on where the cameras stand and {left_out}: {some}.",)


def _paired(task: RigTask, camera: int, calibration: Calibration) -> Calibration:
    """The calibration with the views of pairs first, in the same order for both cameras, then the others that took
    part."""
    order = [task.sights[camera][key] for key in task.keys if key is not None]
    order += [k for c, k in task.rows if c == camera]
    every = dict.fromkeys([*order, *range(len(calibration.views))])
    return replace(calibration, views=tuple(calibration.views[k] for k in every))


def _epipolar(task: RigTask, fit: robust.Fit) -> float:
    """RMS distance of corners from their epipolar planes, as an angle × focal length, px, over both cameras; NaN if no
    corner was seen by both."""
    rows = matches(task.corners, task.ij, fit.used).get((0, 1))
    if rows is None:
        return float("nan")
    left, right = fit.state.cameras
    gaps = epipolar_gaps(left, right, fit.state.rig[1], *(task.corners.xy[each] for each in rows))
    known = gaps[np.isfinite(gaps)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")
