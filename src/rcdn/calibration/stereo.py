"""Calibration of two cameras that see the same boards: their relative pose, and rectification of their images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.arguments import check_boards
from rcdn.calibration.bundle import Corners3, State, default_free
from rcdn.calibration.calibrate import calibrate, check_arguments, names_of, with_geometries
from rcdn.calibration.coded import Geometries, Spacing
from rcdn.calibration.common_model import one_model
from rcdn.calibration.epipolar import epipolar_gaps, matches
from rcdn.calibration.joint_views import JointViews, camera_jacobian, rms_of, solved_camera, solved_view
from rcdn.calibration.labels import Size
from rcdn.calibration.one_thread import one_thread
from rcdn.calibration.relative_pose import FEWEST_PAIRS, determines_pose, matrix, place
from rcdn.calibration.shape import KNOWN, on_shape
from rcdn.calibration.solver import Arrow
from rcdn.calibration.stereo_verdict import judged_stereo
from rcdn.calibration.uncertainty import covariance
from rcdn.errors import CalibrationError, ConfigError, many
from rcdn.types import Array, Board, BoardShape, Calibration, Camera, Pose, Rig, StereoCalibration

Names = tuple[Sequence[str], Sequence[str]]


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
) -> StereoCalibration:
    """Calibrate both cameras and the pose of the right one relative to the left, from boards that both saw at the same
    moment.

    `left`, `right`: the cameras' boards, including partial ones and boards that only one camera saw (they help its
    lens). `pairs`: (index in `left`, index in `right`) of the same board at the same moment; default: equal indices.
    Only boards whose place on the whole board is known (settled labels) determine the relative pose; for a symmetric
    board, the turn that agrees with the other pairs is taken. `names` of the images; all else as in `calibrate`.

    Starts from each camera's own calibration, then estimates lenses, board poses and relative pose jointly. Raises
    CalibrationError if the pairs do not agree on the relative pose; it says so if mirrored images would explain it.
    """
    check_boards(left, "left")
    check_boards(right, "right")
    return stereo_solution(left, right, spacing, pairs=pairs, names=names, model=model, size=size).stereo


@dataclass(frozen=True, eq=False)
class StereoSolution:
    """A stereo calibration and its joint solution: `state`, both cameras, the poses in the left one, and the relative
    pose; `arrow`, the factor of its normal matrix; `cov` (P + 6, P + 6), the covariance of the shared parameters (left
    lens, right lens, relative pose) and of the boards' mean motion in the left camera, over `used` frames."""

    stereo: StereoCalibration
    state: State
    arrow: Arrow
    cov: Array
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
) -> StereoSolution:
    """`calibrate_stereo` with the covariance of all parameters together."""
    pairs = _pairs(left, right, pairs)
    if pairs and all(np.array_equal(left[a].xy, right[b].xy) for a, b in pairs):
        raise ConfigError("left and right are the same boards, corner by corner; give the other camera's pictures")
    named = names or (None, None)
    geometries = _common(left, right, spacing, size)
    first = _alone(0, left, geometries or spacing, named[0], model, size)
    second = _alone(1, right, geometries or spacing, named[1], model, size or first.size)
    if first.size != second.size:
        raise CalibrationError(
            f"the cameras saw different boards ({_text(first.size)} left, {_text(second.size)} right): "
            "name the size to use"
        )
    note = ""
    if model == "auto":
        boards, whole = (left, right), size or first.size
        first, second, note = one_model(
            (first, second),
            lambda side, name: _alone(side, boards[side], geometries or spacing, named[side], name, whole),
            pairs,
        )
    shared = [p for p in pairs if determines_pose(first.views[p[0]], second.views[p[1]])]
    if len(shared) < FEWEST_PAIRS:
        some = many(len(shared), "pair shows", "pairs show")
        raise CalibrationError(
            f"only {some} the whole board to both cameras, {FEWEST_PAIRS} are the least: take 10 or more, "
            "and check that the pictures are given in the same order or with the same names"
        )
    T, turned, odd = place(first, second, shared, pairs)
    task = stereo_task(first, second, [p for p in shared if p not in odd], turned)
    start = stereo_start(task, first, second, T)
    start, noise = robust.initial_fit(start, task.corners, task.sigma, default_free(start, rig=True))
    fit = robust.fit(start, noise, task.corners, task.sigma, default_free(start, rig=True))
    done, cov = _result(task, fit, first, second, odd)
    judged = judged_stereo(replace(done, advice=(*done.advice, note)) if note else done)
    return StereoSolution(judged, fit.state, fit.arrow, cov, sum(not reason for reason in fit.reasons))


def _common(left: Sequence[Board], right: Sequence[Board], spacing: Spacing, size: Size | None) -> Geometries | None:
    """The targets that both cameras saw, so that a corner has the same label in both; None if no board's codes were
    read."""
    both = [*left, *right]
    return Geometries.of(both, spacing, size) if any(b.target is not None for b in both) else None


def _alone(
    side: int,
    boards: Sequence[Board],
    of: Spacing | Geometries,
    names: Sequence[str] | None,
    model: str,
    size: Size | None,
) -> Calibration:
    """The calibration of the left (0) or the right (1) camera alone, from boards of a spacing or of known geometries;
    errors name the camera."""
    try:
        if not isinstance(of, Geometries):
            return calibrate(boards, of, names=names, model=model, size=size)
        check_arguments(boards, names, model, size)
        return with_geometries(boards, of, names_of(boards, names), model)
    except CalibrationError as error:
        raise CalibrationError(f"{('left', 'right')[side]} camera: {error}") from error


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
    if any(not (0 <= a < len(left) and 0 <= b < len(right)) for a, b in pairs):
        raise ConfigError("pairs must hold (index in left, index in right)")
    if any(len({p[side] for p in pairs}) < len(pairs) for side in (0, 1)):
        raise ConfigError("pairs must not hold an index of left or right twice")
    return list(pairs)


@dataclass(frozen=True, eq=False)
class StereoTask:
    """Frames of the joint problem: `seen` (index of the left view or −1, of the right view or −1), with all their
    `corners` and labels `ij` (N, 2); `rows`: (camera, view) → rows of the corners; `shape` of the board, that of the
    left camera's calibration."""

    seen: list[tuple[int, int]]
    ij: Array
    corners: Corners3
    sigma: Array
    rows: dict[tuple[int, int], Array]
    shape: BoardShape | None


def stereo_task(
    first: Calibration, second: Calibration, pairs: list[tuple[int, int]], turned: dict[int, int]
) -> StereoTask:
    """The joint problem of the views of both calibrations, of which `pairs` are of the same board at the same moment;
    `turned`: quarter turns of the right views' labels."""
    lefts, rights = {a for a, _ in pairs}, {b for _, b in pairs}
    alone = [(k, -1) for k, v in enumerate(first.views) if not v.reason and k not in lefts]
    alone += [(-1, k) for k, v in enumerate(second.views) if not v.reason and k not in rights]
    seen = [*pairs, *alone]
    views = JointViews(first)
    for f, pair in enumerate(seen):
        for c, (k, calibration) in enumerate(zip(pair, (first, second), strict=True)):
            if k >= 0:
                views.add(calibration, (c, k), f, c, turned.get(k, 0) if c else 0)
    rows = views.joined()
    board, basis, shaped = rows.flat, np.zeros((len(rows.ij), 1)), rows.shaped
    board[shaped], basis[shaped] = on_shape(board[shaped], rows.ij[shaped], first.shape)
    corners = Corners3(rows.frame, rows.camera, board, rows.xy, basis)
    return StereoTask(seen, rows.ij, corners, rows.sigma, views.rows, first.shape)


def stereo_start(task: StereoTask, first: Calibration, second: Calibration, T: Array) -> State:
    """The joint state from both calibrations and the relative pose `T` (4, 4)."""
    poses = [matrix(first.views[a]) if a >= 0 else np.linalg.inv(T) @ matrix(second.views[b]) for a, b in task.seen]
    return State((first.camera, second.camera), np.array(poses), np.stack([np.eye(4), T]), KNOWN)


def _result(
    task: StereoTask, fit: robust.Fit, first: Calibration, second: Calibration, odd: list[tuple[int, int]]
) -> tuple[StereoCalibration, Array]:
    """The calibration, and the covariance of all parameters as in `StereoSolution`."""
    used = [f for f, reason in enumerate(fit.reasons) if not reason]
    pairs = [f for f in used if min(task.seen[f]) >= 0]
    if len(pairs) < FEWEST_PAIRS:
        raise CalibrationError(
            f"only {many(len(pairs), 'pair agrees', 'pairs agree')} with the others: "
            "check that pictures are paired by moment"
        )
    cov, T = covariance(fit.arrow, np.array(used), fit.scale, fit.clustered), fit.state.rig[1]
    rig = Rig(("left", "right"), fit.state.cameras, tuple(Pose(each) for each in fit.state.rig))
    jacobians = [camera_jacobian(rig, c, len(cov)) for c in range(2)]
    left, right = (
        _one(task, fit, calibration, c, J @ cov @ J.T)
        for c, (calibration, J) in enumerate(zip((first, second), jacobians, strict=True))
    )
    left, right = (_paired(task, c, calibration) for c, calibration in enumerate((left, right)))
    rectified = _rectify(left.camera, right.camera, T)
    lenses = len(left.camera.parameters) + len(right.camera.parameters)
    places = slice(lenses, lenses + 6)
    advice = _odd_pairs([f"{first.views[a].name} and {second.views[b].name}" for a, b in odd])
    return StereoCalibration(
        left, right, T, cov[places, places], rms_of(fit), _epipolar(task, fit), *rectified, advice
    ), cov


def _odd_pairs(names: list[str]) -> tuple[str, ...]:
    """Advice that names the pairs that were left out."""
    if not names:
        return ()
    some = f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''}"
    those = many(len(names), "pair disagrees", "pairs disagree")
    left_out = "was left out" if len(names) == 1 else "were left out"
    return (f"{those} with the others on where the cameras stand and {left_out}: {some}.",)


def _one(task: StereoTask, fit: robust.Fit, before: Calibration, camera: int, cov: Array) -> Calibration:
    """One camera's calibration after the joint solution."""
    views = []
    for k, view in enumerate(before.views):
        rows = task.rows.get((camera, k))
        if rows is None:
            views.append(view)
            continue
        f = int(task.corners.frame[rows[0]])
        T = fit.state.rig[camera] @ fit.state.poses[f]
        views.append(solved_view(view, task.ij, rows, T, fit, fit.reasons[f]))
    return solved_camera(before, camera, views, fit, task.shape, cov)


def _paired(task: StereoTask, camera: int, calibration: Calibration) -> Calibration:
    """The calibration with views in the order of the frames, so that pairs come first, in the same order for both
    cameras."""
    order = [pair[camera] for pair in task.seen if pair[camera] >= 0]
    rest = [k for k in range(len(calibration.views)) if k not in set(order)]
    return replace(calibration, views=tuple(calibration.views[k] for k in [*order, *rest]))


def _epipolar(task: StereoTask, fit: robust.Fit) -> float:
    """RMS distance of corners from their epipolar planes, as an angle × focal length, px, over both cameras; NaN if no
    corner was seen by both."""
    rows = matches(task.corners, task.ij, fit.used).get((0, 1))
    if rows is None:
        return float("nan")
    left, right = fit.state.cameras
    gaps = epipolar_gaps(left, right, fit.state.rig[1], *(task.corners.xy[each] for each in rows))
    return float(np.sqrt(np.nanmean(gaps**2)))


def _rectify(left: Camera, right: Camera, T: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Rotations, projections and Q that rectify both images to one plane (Bouguet's method, OpenCV's stereoRectify)."""
    nothing = np.zeros(5)
    R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(
        left.K,
        nothing,
        right.K,
        nothing,
        left.image_size,
        T[:3, :3].copy(),
        T[:3, 3:].copy(),
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    return R1, R2, P1, P2, Q
