"""Pose of one board under a known camera, with both solutions that a planar board allows."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.arguments import check_board, check_camera, side_of_square
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.coded import frame_of
from rcdn.calibration.shape import KNOWN, all_labels, on_shape
from rcdn.calibration.start import Seen, poses
from rcdn.calibration.uncertainty import pose_covariance
from rcdn.calibration.usable import sigma_of
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry import unproject
from rcdn.geometry.order import turn_labels
from rcdn.geometry.part import of_other_colours, quarter_turns
from rcdn.geometry.rigid import motion, rotation_angle, unit
from rcdn.types import Array, Board, BoardShape, Camera, Pose, PoseEstimate
from rcdn.types.arrays import Real

FEWEST = 4
NO_POSE = "no pose fits the board's corners: are its labels right, and is it this camera?"
SURE = 9.0
"""least difference of the two poses' sums of whitened squares: three standard deviations"""
ASIDE = 0.1
"""least z of a unit ray, after a rotation that centres the board, for IPPE's planar image (84°)"""


def estimate_pose(
    board: Board, camera: Camera, spacing: float | None = None, *, shape: BoardShape | None = None
) -> PoseEstimate:
    """`T_cam_board` of `board` under `camera`: the pose of its corner (0, 0), its columns (x), rows (y) and back (z).

    `spacing`: side of a square (of a triangle, of a tag), m (default: the translation is in sides). `shape`:
    `Calibration.shape`, for whole boards, in metres: with it, `spacing` must be given, too (`Calibration.spacing`);
    that of boards of the transposed size is turned to `board`'s labels, as by `Board.grid_of`, and that of square
    boards to one whose square inside (0, 0) is bright. Starts from both poses that a plane allows (IPPE, Collins &
    Bartoli 2014), refines them with corners weighted by sigma and without outliers, and returns the better one;
    `ambiguous` if the difference is not significant. Labels are the board's own: the origin of a partial board is its
    own first corner, that of a board whose codes were read is its target's; `T_cam_target` is then the same pose in the
    coordinates that the target's own tools use. Raises CalibrationError if fewer than 4 corners, or only corners in one
    line, have viewing rays, and ConfigError for a camera of another picture size than the board's, for a corner without
    a position (NaN), and for a `shape` without a `spacing`.
    """
    side = side_of_square(spacing, shape)
    check_board(board)
    check_camera(camera)
    if tuple(board.image_size) != tuple(camera.image_size):
        (width, height), (wide, high) = board.image_size, camera.image_size
        raise ConfigError(
            f"camera: its pictures have {wide}×{high} px, and the board's has {width}×{height}: give the camera that "
            "took the picture, at that size"
        )
    corners, sigma = pose_corners(board, side, shape)
    starts = _worth(camera, _starts(camera, corners), corners)
    fits = sorted((_fit(camera, T, corners, sigma) for T in starts), key=lambda f: (f.noise, f.scale))
    fits = [f for f in fits if not f.reasons[0]]
    if not fits:
        raise CalibrationError(NO_POSE)
    first = fits[0]
    others = [f for f in fits[1:] if _apart(first, f)]
    worse = [_square(f, first) - _square(first, first) for f in others]
    gaps = residuals(first.state, corners)
    length = (gaps[first.used] ** 2).sum(axis=1)
    return PoseEstimate(
        first.state.poses[0],
        pose_covariance(first.state, corners, first.weight, first.arrow, first.scale),
        float(np.sqrt(length.mean())),
        gaps,
        Pose(others[0].state.poses[0]) if others else None,
        bool(others and worse[0] < SURE * first.scale),
        None if board.target is None else first.state.poses[0] @ frame_of(board.target, side),
    )


def pose_corners(board: Board, spacing: float, shape: BoardShape | None) -> tuple[Corners3, Array]:
    """The corners of one board that one camera saw, and their sigma (N,) px."""
    zero = np.zeros(len(board), int)
    places, basis = on_shape(board.points * spacing, board.ij, None if shape is None else _shape_of(board, shape))
    return Corners3(zero, zero, places, board.xy, basis), np.nan_to_num(sigma_of(board))


def _shape_of(board: Board, shape: BoardShape) -> BoardShape:
    """`shape` by the labels of the whole `board`: that of boards of the transposed size, or of square ones of the other
    colours, is turned by a quarter, as calibrations turn those. Raises ConfigError if it is that of other boards."""
    if not isinstance(shape, BoardShape):
        raise ConfigError(f"shape must be a BoardShape, as Calibration.shape is, not {type(shape).__name__}")
    if board.pattern == "checker" and board.size == shape.size and not of_other_colours(board, True):
        return shape
    if board.pattern != "checker" or board.target is not None or board.size != shape.size[::-1]:
        raise ConfigError(
            f"shape: it is that of whole boards of {shape.size[0]}×{shape.size[1]} corners, and this one shows "
            f"{board.size[0]}×{board.size[1]}: leave it out"
        )
    turn, (columns, rows) = quarter_turns(board.size), board.size
    corner, right, below = turn_labels(np.array([[0, 0], [1, 0], [0, 1]]), board.size, turn)
    there = shape.at(turn_labels(all_labels(board.size), board.size, turn))
    within = there[:, :2] @ np.stack([right - corner, below - corner], axis=1)
    return BoardShape(np.column_stack([within, there[:, 2]]).reshape(rows, columns, 3))


def _state(camera: Camera, T: Array) -> State:
    return State.mono(camera, T[None], KNOWN)


def _starts(camera: Camera, corners: Corners3) -> list[Array]:
    """Initial poses (4, 4): both of IPPE if all rays lie within 84° of the board's direction, otherwise that of the
    rays' homography."""
    rays = unproject(camera, corners.xy)
    seen = np.isfinite(rays).all(axis=1)
    if seen.sum() < FEWEST or np.linalg.matrix_rank(corners.board[seen] - corners.board[seen].mean(axis=0), 1e-9) < 2:
        raise CalibrationError(
            f"a pose needs {FEWEST} corners, not all in one line, with viewing rays; "
            f"the board has {int(seen.sum())} that this camera can see"
        )
    rays = unit(rays[seen])
    turn = _facing(rays.mean(axis=0))
    flat = rays @ turn.T
    if flat[:, 2].min() < ASIDE:
        return list(poses(camera, [Seen(corners.board[seen], corners.xy[seen])]))
    points = np.column_stack([corners.board[seen], np.zeros(int(seen.sum()))])
    try:
        _, vectors, shifts, _ = cv2.solvePnPGeneric(
            points, flat[:, :2] / flat[:, 2:], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error as error:
        raise CalibrationError(NO_POSE) from error
    return [_back(turn, cv2.Rodrigues(r)[0], t) for r, t in zip(vectors, shifts, strict=True)]


def _worth(camera: Camera, starts: list[Array], corners: Corners3) -> list[Array]:
    """The initial poses whose median residual is not much larger than that of the best."""
    miss = []
    for T in starts:
        gaps = np.linalg.norm(residuals(_state(camera, T), corners), axis=1)
        miss.append(float(np.median(np.nan_to_num(gaps, nan=np.inf))))
    return [T for T, m in zip(starts, miss, strict=True) if np.isfinite(m) and m <= robust.HOPEFUL * min(miss)]


def _facing(direction: Array) -> Real[Array, "3 3"]:
    """(3, 3) a rotation that takes `direction` to the z axis."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _back(turn: Array, R: Array, t: Array) -> Array:
    return motion(turn.T @ R, turn.T @ np.ravel(t))


def _fit(camera: Camera, T: Array, corners: Corners3, sigma: Array) -> robust.Fit:
    start = _state(camera, T)
    nothing = default_free(start, lens=False)
    state, noise = robust.initial_fit(start, corners, sigma, nothing, turn=False)
    return robust.fit(state, noise, corners, sigma, nothing)


def _apart(a: robust.Fit, b: robust.Fit) -> bool:
    """True if the two fits converged to different poses (by more than half a degree)."""
    R = a.state.poses[0, :3, :3].T @ b.state.poses[0, :3, :3]
    return rotation_angle(R) > 0.5


def _square(fit: robust.Fit, of: robust.Fit) -> float:
    """Sum of whitened squares of one fit, over the inliers and with the weights of the fit `of`."""
    square = (fit.residuals**2).sum(axis=1) * of.weight**2
    return float(np.nan_to_num(square[of.used], nan=np.inf).sum())
