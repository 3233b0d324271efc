"""Figures of Table 4 for one detector on one set: reprojection errors as in the paper and, where the truth is known,
the errors against it.

A reprojection error is also small if bad corners are left out or if the camera model adapts to them. Against the truth
neither helps: the 95 % quantile of the corners' errors counts missing ones as infinite, and the model is evaluated at
every true corner, found or not.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from rcdn.calibration import calibrate_stereo
from rcdn.errors import CalibrationError, present
from rcdn.geometry import project
from rcdn.types import Array, Camera, CameraModel
from rcdn_lab.calibration.protocol import FEWEST, Half, half, halves, root_mean_square, task_of, without_outliers
from rcdn_lab.camera_scenes import board

NAN = float("nan")
SHARE = 0.95
"""share of all true corners whose error is below the reported one"""
TURNS = [np.array(m) for m in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])]


@dataclass(frozen=True, eq=False)
class Truth:
    """The true `camera` and what it saw: `T` (V, 4, 4) T_cam_board of its pictures, squares; `xy` (V, M, 2) px of all
    corners, row by row."""

    camera: Camera
    T: Array
    xy: Array


@dataclass(frozen=True, eq=False)
class Boards:
    """The boards that a detector found in the pictures of one camera: for each picture in `index` (n,) one of `boards`,
    labels (m, 2) and pixels (m, 2).

    `image_size` (width, height); `size` (columns, rows) of the whole board; `model` of the lens; `pictures`, the number
    that show a board; `truth` of all pictures: labels are then the true ones (`relabelled`).
    """

    index: list[int]
    boards: list[tuple[Array, Array]]
    image_size: tuple[int, int]
    size: tuple[int, int]
    model: CameraModel
    pictures: int
    truth: Truth | None = None

    @property
    def corners(self) -> int:
        """The number of corners."""
        return sum(len(xy) for _, xy in self.boards)


@dataclass(frozen=True)
class Figures:
    """Figures of one detector on one set; NaN where unknown.

    `cal`, `pose`: root mean square reprojection error, px, of the half calibrated from, and of the other one, of which
    only poses are solved; `outliers`: corners that `rcdn.calibrate` would leave out (none are here). Against the truth:
    `mean`, `rms` of the found corners, px, and `most`, within which 95 % of all true corners are found; `focal`,
    `centre`: of the cameras, px; `rotation` (degrees) and `translation` (share of the distance) of the held-out poses;
    `model`: distance, px, between all true corners of the held-out half, found or not, and their projections by camera
    and pose.
    """

    cal: float = NAN
    pose: float = NAN
    outliers: float = NAN
    mean: float = NAN
    rms: float = NAN
    most: float = NAN
    focal: float = NAN
    centre: float = NAN
    rotation: float = NAN
    translation: float = NAN
    model: float = NAN


def relabelled(ij: Array, xy: Array, true: Array, size: tuple[int, int]) -> Array:
    """Labels (m, 2) on the true board: `ij` after the rotation and translation supported by most corners, each matched
    to the nearest of `true` (M, 2)."""
    near = cKDTree(true).query(xy)[1]
    label = np.stack([near % size[0], near // size[0]], axis=1)
    votes = Counter((k, *map(int, s)) for k, turn in enumerate(TURNS) for s in label - ij @ turn.T)
    (turn, *shift), _ = votes.most_common(1)[0]
    return np.asarray(ij @ TURNS[turn].T + shift)


def figures(parts: Sequence[Boards]) -> Figures:
    """Figures of the boards of one set, by camera. Errors are over its cameras together and both directions of a split;
    the median over the splits.

    Only corner errors if a camera has fewer than 6 boards. Raises CalibrationError if one has no camera.
    """
    mean, rms, most = corner_errors(parts)
    if any(len(p.boards) < FEWEST for p in parts):
        return Figures(mean=mean, rms=rms, most=most)
    tasks = [task_of(p.boards, p.image_size, p.size, p.model) for p in parts]
    outliers = sum(int((~without_outliers(t).used).sum()) for t in tasks)
    splits = [list(halves(t.views)) for t in tasks]
    runs = [
        [(p, half(t, *way)) for p, t, s in zip(parts, tasks, splits, strict=True) for way in (s[k], s[k][::-1])]
        for k in range(len(splits[0]))
    ]
    cal, pose = (_median(root_mean_square([getattr(h, w) for _, h in run]) for run in runs) for w in ("cal", "pose"))
    if any(p.truth is None for p in parts):
        return Figures(cal, pose, outliers, mean, rms, most)
    gaps = [_together([_against_truth(p, h) for p, h in run]) for run in runs]
    focal, centre, rotation, translation, model = (_median(g[k] for g in gaps) for k in range(5))
    return Figures(cal, pose, outliers, mean, rms, most, focal, centre, rotation, translation, model)


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))


def corner_errors(parts: Sequence[Boards]) -> tuple[float, float, float]:
    """Mean and root mean square distance of the found corners from the truth, px, and the distance within which 95 % of
    all true corners are found.

    NaN without truth, and the last if fewer are found. A corner whose label is not on the board is ignored here.
    """
    errors, many = [], 0
    for part in parts:
        if part.truth is None:
            return NAN, NAN, NAN
        many += part.pictures * part.size[0] * part.size[1]
        for k, (ij, xy) in zip(part.index, part.boards, strict=True):
            known = ((ij >= 0) & (ij < part.size)).all(axis=1)
            true = part.truth.xy[k][ij[known, 1] * part.size[0] + ij[known, 0]]
            errors.append(np.linalg.norm(xy[known] - true, axis=1))
    every = np.sort(np.concatenate(errors)) if errors else np.zeros(0)
    if not len(every):
        return NAN, NAN, NAN
    last = int(np.ceil(SHARE * many)) - 1
    most = float(every[last]) if last < len(every) else NAN
    return float(every.mean()), float(np.sqrt(np.square(every).mean())), most


def _against_truth(part: Boards, done: Half) -> tuple[Array, ...]:
    """Errors of a camera and of the held-out poses: focal lengths (2,), centre (1,), px; rotation (n,), degrees;
    translation of the board's centre (n,), share of its distance; model (n · M,), px."""
    truth = present(part.truth, "the truth of a set")
    camera, index = done.state.cameras[0], [part.index[k] for k in done.others]
    off = camera.K - truth.camera.K
    T, known = done.state.poses[done.others], truth.T[index]
    ij = np.stack(np.meshgrid(np.arange(part.size[0]), np.arange(part.size[1])), axis=-1).reshape(-1, 2)
    points = np.column_stack([ij, np.zeros(len(ij)), np.ones(len(ij))])
    seen, true = points @ T[:, :3].transpose(0, 2, 1), points @ known[:, :3].transpose(0, 2, 1)
    turn = np.einsum("nij,nik->njk", known[:, :3, :3], T[:, :3, :3])
    middle, true_middle = seen.mean(axis=1), true.mean(axis=1)
    shift = np.linalg.norm(middle - true_middle, axis=1) / np.linalg.norm(true_middle, axis=1)
    gap = np.linalg.norm(project(camera, seen.reshape(-1, 3)) - truth.xy[index].reshape(-1, 2), axis=1)
    return off[[0, 1], [0, 1]], np.array([np.hypot(*off[:2, 2])]), angle(turn), shift, gap


def angle(R: Array) -> Array:
    """(n,) rotation angles of rotation matrices (n, 3, 3), degrees; accurate for small ones."""
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    return np.degrees(np.arctan2(np.linalg.norm(sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1))


def _together(parts: Sequence[tuple[Array, ...]]) -> list[float]:
    """Root mean square of each kind of error."""
    return [
        float(np.sqrt(np.square(np.nan_to_num(np.concatenate(kind), nan=np.inf)).mean()))
        for kind in zip(*parts, strict=True)
    ]


@dataclass(frozen=True)
class Rig:
    """Accuracy of the relative pose of two cameras: number of `pairs` used; `baseline` error, µm; `turn`, rotation
    error of the right camera, degrees; `note`: the reason if there is no result."""

    pairs: int = 0
    baseline: float = NAN
    turn: float = NAN
    note: str = ""


def rig_of(left: Boards, right: Boards, spacing: float, T_right_left: Array) -> Rig:
    """By `rcdn.calibrate_stereo` from the whole boards that both cameras saw, compared with the true pose (m);
    `spacing` of the squares, m."""
    first, second = (
        {k: board(ij, xy, p.image_size) for k, (ij, xy) in zip(p.index, p.boards, strict=True) if _fits(ij, p.size)}
        for p in (left, right)
    )
    pairs = sorted(first.keys() & second.keys())
    sides = [first[k] for k in pairs], [second[k] for k in pairs]
    try:
        done = calibrate_stereo(*sides, spacing, model=left.model, size=left.size)
    except CalibrationError as error:
        return Rig(len(pairs), note=f"no stereo calibration: {error}")
    apart = abs(done.baseline - float(np.linalg.norm(T_right_left[:3, 3])))
    turn = angle((T_right_left[:3, :3].T @ done.T_right_left[:3, :3])[None])
    return Rig(len(pairs), 1e6 * apart, float(turn[0]))


def _fits(ij: Array, size: tuple[int, int]) -> bool:
    """Whether these are all labels of the whole board."""
    return len(np.unique(ij, axis=0)) == len(ij) == size[0] * size[1] and bool(((ij >= 0) & (ij < size)).all())
