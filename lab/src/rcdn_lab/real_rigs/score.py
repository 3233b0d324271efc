"""How well a rig predicts boards that it wasn't calibrated from: corners triangulated in space,
and boards projected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.shape import KNOWN, on_shape
from rcdn.calibration.solver import solve
from rcdn.geometry import project, unproject
from rcdn.types import Array, Board, BoardShape, Rig

ROUNDS = 3
"""of triangulation, each ray weighing by the distance found before"""


@dataclass(frozen=True, eq=False)
class Scored:
    """Of the boards of one moment: `steps` (E,) lengths between neighbouring corners ÷ the spacing − 1, `spans` (S,)
    the same of the first and last corner of each row and column, with the labels `step_ends` (E, 4) and `span_ends`
    (S, 4) of both corners; `rays` (N,) px from each corner to its triangulated point as its camera sees that; `board`
    (N,) px from each corner to that of the flat board, or that of its shape, in the pose that fits all cameras best.
    NaN: a camera has no ray."""

    steps: Array
    step_ends: Array
    spans: Array
    span_ends: Array
    rays: Array
    board: Array


def scored(rig: Rig, boards: Mapping[str, Board], spacing: float, shape: BoardShape | None = None) -> Scored | None:
    """One moment's `boards` by camera under a rig; None unless two of its cameras saw four corners of it together."""
    seen = {n: board for n, board in boards.items() if n in rig.names}
    every = [{tuple(ij) for ij in board.ij.tolist()} for board in seen.values()]
    labels = sorted({x for one in every for x in one if sum(x in other for other in every) > 1})
    if len(labels) < 4 or np.ptp(np.array(labels), axis=0).min() == 0:
        return None
    places, xy = np.array(labels), {n: _at(board, labels) for n, board in seen.items()}
    points = triangulated(rig, xy)
    rays = [np.linalg.norm(each - _seen(rig, n, points), axis=1) for n, each in xy.items()]
    there = [np.isfinite(each).all(axis=1) for each in xy.values()]
    steps, spans = _steps(places), _spans(places)
    return Scored(
        *_lengths(points, places, steps, spacing),
        *_lengths(points, places, spans, spacing),
        np.concatenate([r[t] for r, t in zip(rays, there, strict=True)]),
        _of_board(rig, xy, places, points, spacing, shape),
    )


def _at(board: Board, labels: list[tuple[int, ...]]) -> Array:
    """(N, 2) px of the corners with these labels; NaN where the board hasn't them."""
    at = {tuple(ij): k for k, ij in enumerate(board.ij.tolist())}
    return np.array([board.xy[at[x]] if x in at else (np.nan, np.nan) for x in labels])


def triangulated(rig: Rig, xy: Mapping[str, Array]) -> Array:
    """(N, 3) the points of the rig's frame whose angles to the rays of `xy` (N, 2) by camera have the least sum of
    squares; NaN under two rays."""
    eyes, ways = [], []
    for name, each in xy.items():
        k = rig.index(name)
        pose, rays = rig.poses[k], np.full((len(each), 3), np.nan)
        known = np.isfinite(each).all(axis=1)
        rays[known] = unproject(rig.cameras[k], each[known])
        ways.append(rays / np.linalg.norm(rays, axis=1, keepdims=True) @ pose.R)
        eyes.append(-pose.R.T @ pose.t)
    way, eye = np.array(ways), np.array(eyes)[:, None]
    there = np.isfinite(way).all(axis=2) & np.isfinite(eye).all()
    way = np.where(there[..., None], way, 0.0)
    across = np.eye(3) - way[..., :, None] * way[..., None, :]
    weight = there.astype(float)
    points = np.zeros((way.shape[1], 3))
    for _ in range(ROUNDS):
        weight = weight / np.maximum(weight.max(axis=0), 1e-300)
        A = np.einsum("cn,cnij->nij", weight, across) + 1e-12 * np.eye(3)
        b = np.einsum("cn,cnij,cnj->ni", weight, across, np.broadcast_to(eye, way.shape))
        points = np.linalg.solve(A, b[..., None])[..., 0]
        weight = there / np.maximum(((points - eye) ** 2).sum(axis=2), 1e-12)
    points[there.sum(axis=0) < 2] = np.nan
    return points


def _seen(rig: Rig, name: str, points: Array) -> Array:
    pose = rig.poses[rig.index(name)]
    return project(rig.cameras[rig.index(name)], points @ pose.R.T + pose.t)


def _steps(places: Array) -> Array:
    """(E, 2) indices of neighbouring corners."""
    at = {tuple(x): k for k, x in enumerate(places.tolist())}
    ends = [(k, at[x]) for (i, j), k in at.items() for x in ((i + 1, j), (i, j + 1)) if x in at]
    return np.array(ends, int).reshape(-1, 2)


def _spans(places: Array) -> Array:
    """(S, 2) indices of the first and the last corner of each row and each column."""
    ends = []
    for along in (0, 1):
        for line in np.unique(places[:, 1 - along]):
            mine = np.flatnonzero(places[:, 1 - along] == line)
            if len(mine) > 1:
                ends.append((mine[np.argmin(places[mine, along])], mine[np.argmax(places[mine, along])]))
    return np.array(ends, int).reshape(-1, 2)


def _lengths(points: Array, places: Array, ends: Array, spacing: float) -> tuple[Array, Array]:
    """The lengths (E,) between corners with the indices `ends` (E, 2), ÷ what they should be, − 1, and the labels
    (E, 4) of these corners."""
    a, b = ends.T
    nominal = spacing * np.abs(places[b] - places[a]).sum(axis=1)
    return np.linalg.norm(points[a] - points[b], axis=1) / nominal - 1, np.column_stack([places[a], places[b]])


def _of_board(
    rig: Rig, xy: Mapping[str, Array], places: Array, points: Array, spacing: float, shape: BoardShape | None
) -> Array:
    """(N,) px of all corners of all cameras from the board in the pose that fits them best."""
    flat, basis = on_shape(places * spacing, places, shape)
    known = np.isfinite(points).all(axis=1)
    if known.sum() < 3 or np.linalg.matrix_rank(points[known] - points[known].mean(axis=0), 1e-9) < 2:
        return np.full(1, np.nan)
    parts = []
    for c, each in enumerate(xy.values()):
        there = np.flatnonzero(np.isfinite(each).all(axis=1))
        parts.append((np.zeros(len(there), int), np.full(len(there), c), flat[there], each[there], basis[there]))
    corners = Corners3(*(np.concatenate(p) for p in zip(*parts, strict=True)))
    at = [rig.index(name) for name in xy]
    places_of = rig.T_cam_rig[at]  # held: the frame of the poses is the rig's
    state = State(tuple(rig.cameras[k] for k in at), _fitted(flat[known], points[known])[None], places_of, KNOWN)
    free = default_free(state, lens=False)
    state = solve(state, corners, np.ones(len(corners)), free).state
    return np.asarray(np.linalg.norm(residuals(state, corners), axis=1))


def _fitted(flat: Array, points: Array) -> Array:
    """T (4, 4) that brings `flat` (N, 2) nearest to `points` (N, 3) (Kabsch)."""
    board = np.column_stack([flat, np.zeros(len(flat))])
    U, _, Vt = np.linalg.svd((points - points.mean(axis=0)).T @ (board - board.mean(axis=0)))
    T = np.eye(4)
    T[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    T[:3, 3] = points.mean(axis=0) - T[:3, :3] @ board.mean(axis=0)
    return T
