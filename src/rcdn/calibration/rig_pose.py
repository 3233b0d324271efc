"""The pose of one board from all cameras of a known rig that see it at one moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration import robust
from rcdn.calibration.arguments import check_board, check_by_camera, check_rig, side_of_square
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.coded import frame_of, identity
from rcdn.calibration.pose import estimate_pose, pose_corners
from rcdn.calibration.relative_pose import AGREE
from rcdn.calibration.shape import KNOWN
from rcdn.calibration.solver import BEHIND, Normal
from rcdn.calibration.uncertainty import pose_covariance
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry.order import turn_labels
from rcdn.geometry.part import labels_of
from rcdn.types import Array, Board, BoardShape, Rig, RigPoseEstimate
from rcdn.types.arrays import Real

TURNS = {"unique": (0,), "ambiguous_180": (0, 2), "ambiguous_90": (0, 1, 2, 3)}
PART = "it shows a part of the board, and nobody knows which"
APART = "it sees the board elsewhere than the other cameras"


def estimate_rig_pose(
    boards: Mapping[str, Board], rig: Rig, spacing: float | None = None, *, shape: BoardShape | None = None
) -> RigPoseEstimate:
    """`T_rig_board` of one board from its detections by the cameras of a rig at one moment.

    `boards`: by the camera's name; without the cameras that did not see it. `spacing`, `shape` and the labels as in
    `estimate_pose`: the labels are those of the camera that shows the most corners, and the others are turned by half
    or quarter turns to match it. Codes relate parts of a board to each other; of a plain board, parts of another size
    than that camera's are left out, as are cameras that see the board elsewhere. The covariance includes that of the
    corners (as in `estimate_pose`) and of the cameras' poses, if the rig has their covariance; lenses are assumed
    exact. Raises CalibrationError if no camera has a pose, RcdnError for a camera that is not in the rig,
    ConfigError for another wrong argument.
    """
    side = side_of_square(spacing, shape)
    check_rig(rig)
    check_by_camera(boards, "boards", "the board that each camera saw,")
    if not boards:
        raise ConfigError("boards must hold the board of one camera at least")
    for name, board in boards.items():
        check_board(board, f"boards[{name!r}]")
        if board.image_size != tuple(rig.cameras[rig.index(name)].image_size):
            raise ConfigError(
                f"boards[{name!r}]: the picture has {board.image_size} px, the camera "
                f"{tuple(rig.cameras[rig.index(name)].image_size)}"
            )
    boards = _labelled_alike(boards)
    sights, reasons = _sights(boards, rig, side, shape)
    if not sights:
        raise CalibrationError("; ".join(f"{name}: {why}" for name, why in reasons.items()))
    first = max(sights, key=lambda name: len(boards[name]))
    best = max((_agreeing(sights, first, T) for T in sights[first].places[0]), key=lambda found: len(found.turns))
    for name in sights:
        if name not in best.turns:
            reasons[name] = PART if boards[name].size != boards[first].size and boards[name].target is None else APART
    return _estimated(boards, rig, side, shape, best, reasons)


def _labelled_alike(boards: Mapping[str, Board]) -> dict[str, Board]:
    """The boards with the labels that whole plain ones have on the board that shows the most corners (`labels_of`): of
    its size and, where a quarter turn exchanges them, of its colours."""
    largest = max(boards.values(), key=len)
    out = dict(boards)
    for name, board in boards.items():
        if board.target is None and _same(board, largest):
            labels = labels_of(board, largest.size, largest.origin_dark)
            if labels is not None and not np.array_equal(labels, board.ij - board.ij.min(axis=0)):
                out[name] = replace(board, ij=labels, origin_dark=largest.origin_dark)
    return out


@dataclass(frozen=True, eq=False)
class _Sight:
    """The observation of one camera: `places`, T_rig_board (4, 4) for each turn of its labels, both solutions of a
    plane; `reach`: distance to the board, m."""

    places: dict[int, list[Array]]
    reach: float


@dataclass(frozen=True, eq=False)
class _Agreed:
    """An initial guess `T` (4, 4), and the turn of the labels of each camera that agrees with it."""

    T: Array
    turns: dict[str, int]


def _sights(
    boards: Mapping[str, Board], rig: Rig, spacing: float, shape: BoardShape | None
) -> tuple[dict[str, _Sight], dict[str, str]]:
    """The observations of the cameras, and the reasons why others have none."""
    largest = max(boards.values(), key=len)
    found, reasons = {}, {}
    for name, board in boards.items():
        if not _same(board, largest):
            reasons[name] = "it shows another board" if board.target != largest.target else PART
            continue
        k = rig.index(name)
        try:
            places = {turn: _places(_turned(board, turn), rig, k, spacing, shape) for turn in _turns(board)}
        except CalibrationError as error:
            reasons[name] = str(error)
            continue
        found[name] = _Sight(places, float(np.linalg.norm((rig.T_cam_rig[k] @ places[0][0])[:3, 3])))
    return found, reasons


def _same(board: Board, largest: Board) -> bool:
    """Whether a label denotes the same corner in both boards, up to turns."""
    if board.target is None or largest.target is None:
        return board.target is None and largest.target is None and sorted(board.size) == sorted(largest.size)
    return identity(board.target) == identity(largest.target)


def _turns(board: Board) -> tuple[int, ...]:
    """Numbers of quarter turns that its colours, as far as they are known, leave open."""
    if board.target is not None:
        return (0,)
    if board.origin_dark is None and board.size[0] == board.size[1]:
        return TURNS["ambiguous_90"]
    return TURNS.get(board.orientation, (0,))


def _turned(board: Board, turn: int) -> Board:
    return replace(board, ij=turn_labels(board.ij, board.size, turn)) if turn else board


def _places(board: Board, rig: Rig, k: int, spacing: float, shape: BoardShape | None) -> list[Array]:
    """T_rig_board (4, 4) from one camera alone: both pose solutions of a plane."""
    found = estimate_pose(board, rig.cameras[k], spacing, shape=shape)
    back = np.linalg.inv(rig.T_cam_rig[k])
    return [back @ found.T_cam_board] + ([] if found.other is None else [back @ found.other.T_cam_board])


def _agreeing(sights: Mapping[str, _Sight], first: str, T: Array) -> _Agreed:
    """The cameras that see the board at T, with the turns that match their labels to those of the camera `first`."""
    turns = {first: 0}
    for name, sight in sights.items():
        if name != first:
            gap, turn = min((_gap(T, U, sight.reach), q) for q, places in sight.places.items() for U in places)
            if gap <= 1:
                turns[name] = turn
    return _Agreed(T, turns)


def _gap(T: Array, U: Array, reach: float) -> float:
    """Distance of two poses of a board, 1 at the limit of agreement."""
    turn = Rotation.from_matrix(T[:3, :3] @ U[:3, :3].T).magnitude()
    return float(max(turn / (2 * AGREE[0]), np.linalg.norm(T[:3, 3] - U[:3, 3]) / (AGREE[1] * reach)))


def _estimated(
    boards: Mapping[str, Board],
    rig: Rig,
    spacing: float,
    shape: BoardShape | None,
    best: _Agreed,
    reasons: Mapping[str, str],
) -> RigPoseEstimate:
    """The least-squares estimate from all cameras that agree."""
    names = [n for n in rig.names if n in best.turns]
    parts = [pose_corners(_turned(boards[n], best.turns[n]), spacing, shape) for n in names]
    camera = np.repeat(np.arange(len(names)), [len(sigma) for _, sigma in parts])
    corners, sigma = _together([c for c, _ in parts], camera), np.concatenate([s for _, s in parts])
    at = [rig.index(n) for n in names]
    places = rig.T_cam_rig[at]  # constant: the poses refer to the rig's frame
    start = State(tuple(rig.cameras[k] for k in at), best.T[None], places, KNOWN)
    nothing = default_free(start, lens=False)
    state, _ = robust.initial_fit(start, corners, sigma, nothing, turn=False)
    sigma = np.hypot(sigma, _offsets(residuals(state, corners), camera))
    fit = robust.fit(state, robust.LEAST_NOISE, corners, sigma, nothing)
    if fit.reasons[0]:
        raise CalibrationError(f"no pose fits what {', '.join(names)} saw: is it this rig, and one moment?")
    step, cov = _weighed(rig, at, fit, corners)
    state, target = fit.state.moved(step[None], np.zeros(len(fit.state.values))), boards[names[0]].target
    T, gaps = state.poses[0], residuals(state, corners)
    return RigPoseEstimate(
        T,
        cov,
        float(np.sqrt((gaps[fit.used] ** 2).sum(axis=1).mean())),
        {n: gaps[camera == c] for c, n in enumerate(names)},
        {n: why for n, why in reasons.items() if n not in names},
        None if target is None else T @ frame_of(target, spacing),
    )


def _offsets(gaps: Array, camera: Array) -> Real[Array, " n"]:
    """(N,) px per axis: the median offset at which each corner's camera sees the board, a bound on the accuracy of that
    camera's pose."""
    far = np.nan_to_num(np.linalg.norm(gaps, axis=1), nan=np.inf)
    typical = np.array([np.median(far[camera == c]) for c in range(int(camera.max()) + 1)])
    return np.asarray(np.minimum(typical, BEHIND)[camera] / np.sqrt(robust.MEDIAN))


def _together(parts: list[Corners3], camera: Array) -> Corners3:
    board, xy, basis = (np.concatenate([getattr(p, k) for p in parts]) for k in ("board", "xy", "basis"))
    return Corners3(np.zeros(len(xy), int), camera, board, xy, basis)


def _weighed(rig: Rig, at: list[int], fit: robust.Fit, corners: Corners3) -> tuple[Array, Array]:
    """The small motion (6,) of the pose to the mean of the cameras' own poses, weighted by their covariances, and its
    covariance (6, 6).

    Generalised least squares with one pose per camera, linearised at the joint solution. The pose from camera k has the
    errors of its corners, and the error δₖ of the camera's own pose, which enters as −Ad(Tₖ)⁻¹ δₖ.
    """
    state, many = fit.state, len(at)
    apart, errors = np.zeros(6 * many), np.zeros((6 * many, 6 * many))
    follow = np.zeros((6 * many, 6 * len(rig)))
    for c, k in enumerate(at):
        mine = slice(6 * c, 6 * c + 6)
        apart[mine], errors[mine, mine] = _own(state, corners, np.where(corners.camera == c, fit.weight, 0.0))
        follow[mine, 6 * k : 6 * k + 6] = -np.linalg.inv(rig.motion_to(k))
    if rig.covariance is not None:
        errors += follow @ rig.covariance @ follow.T
    firm = np.linalg.solve(errors, np.tile(np.eye(6), (many, 1)))
    cov = np.linalg.inv(np.tile(np.eye(6), (1, many)) @ firm)
    return cov @ (firm.T @ apart), (cov + cov.T) / 2


def _own(state: State, corners: Corners3, weight: Array) -> tuple[Array, Array]:
    """The small motion (6,) from the pose to the one estimated from one camera alone, its corners weighted by `weight`,
    and its covariance (6, 6)."""
    nothing = np.zeros(len(state.values))
    here = Normal.of(state, corners, weight, nothing.astype(bool))
    arrow = here.arrow()
    step = arrow.own[0] @ arrow.own[0].T @ here.gradient[0][0]
    own = state.moved(step[None], nothing)
    used = weight > 0
    square = float(((residuals(own, corners)[used] * weight[used, None]) ** 2).sum())
    return step, pose_covariance(own, corners, weight, arrow, square / max(2 * int(used.sum()) - 6, 1))
