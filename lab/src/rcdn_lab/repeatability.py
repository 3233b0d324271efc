"""Repeatability of cameras, compared with their stated uncertainty: random halves of the pictures of one camera,
calibrated separately.

Residuals are no suitable measure: a more flexible model always has smaller ones. Two halves have only the camera in
common, so that their difference shows the uncertainty of a calibration (except for errors that are the same in all
pictures).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.difference import difference
from rcdn.calibration.sight import cell_centres
from rcdn.calibration.uncertainty import unrotated_jacobian
from rcdn.errors import CalibrationError, RcdnError
from rcdn.types import Array, Board, Calibration, Camera
from rcdn.types.arrays import Real

SPLITS, FEWEST = 8, 10
"""random splits of a set; least number of pictures of a set, for its halves to be large enough"""
CELLS = (24, 18)
"""grid over the frame at which two cameras are compared"""
CORE = 4
"""fx, fy, cx, cy: the first of a camera's parameters"""


@dataclass(frozen=True, eq=False)
class Half:
    """One half's `camera`; `std` (4,) px of fx, fy, cx, cy and `spread` (N, 2, 2) px² the covariance of its projections
    at the points after the best rotation, both None if none is stated; or `failure`, the reason why there is no
    camera."""

    camera: Camera | None
    std: Array | None = None
    spread: Array | None = None
    failure: str = ""


@dataclass(frozen=True)
class Repeatability:
    """Figures of one set and one solver: `pictures`; `splits` that gave two cameras and `failed` ones; `px`: root mean
    square over the seen area and the splits of the difference of the halves' cameras after the best rotation,
    `median_px` the median over splits; `focal` the relative difference of fx; `ratio`: root mean square of (difference
    ÷ stated deviation) of fx, fy, cx, cy, `within` the share within one; `projections` and `projections_within` the
    same for projections over the seen area. None: not stated."""

    set: str
    solver: str
    pictures: int
    splits: int
    failed: int
    px: float
    median_px: float
    focal: float
    ratio: float | None
    within: float | None
    projections: float | None
    projections_within: float | None
    models: str


def halves(pictures: Sequence[str], split: int) -> tuple[set[str], set[str]]:
    """Two random halves of the distinct `pictures`, the same for all solvers."""
    names = sorted(set(pictures))
    order = np.random.default_rng([0, split]).permutation(len(names))
    first = {names[k] for k in order[: len(names) // 2]}
    return first, set(names) - first


def seen_area(boards: Sequence[Board]) -> Array:
    """(N, 2) points, px, of a grid over the frame inside the convex hull of all corners."""
    grid = cell_centres(boards[0].image_size, CELLS).reshape(-1, 2)
    hull = cv2.convexHull(np.concatenate([b.xy for b in boards]).astype(np.float32))
    inside = [cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0 for x, y in grid]
    return np.asarray(grid[np.array(inside)])


def ours(boards: Sequence[Board], names: Sequence[str], points: Array, model: str = "auto") -> Half:
    """`rcdn.calibrate` with the users' defaults."""
    try:
        done = calibrate(boards, 1.0, names=names, model=model)
    except CalibrationError as error:
        return Half(None, failure=str(error))
    return Half(done.camera, done.std[:CORE], projection_deviation(done, points))


def projection_deviation(calibration: Calibration, pixels: Real[Array, "n 2"]) -> Real[Array, "n 2 2"]:
    """Covariance (N, 2, 2), px², of the projections of the directions that the camera sees at `pixels` (N, 2), up to a
    rotation of all of them.

    The effect of a rotation of the camera on all pixels is no error: its least-squares estimate over `pixels` is
    removed. The result is comparable with the difference of two calibrations after the best rotation. NaN where the
    lens model has no ray.
    """
    J, _ = unrotated_jacobian(calibration.camera, pixels)
    many = J.shape[2]
    return np.asarray(np.einsum("nia,ab,njb->nij", J, calibration.cov[:many, :many], J, optimize=True))


def opencv(boards: Sequence[Board], names: Sequence[str], points: Array, model: str) -> Half:
    """OpenCV's solver for a lens `model` on the same corners, with its standard deviations of fx, fy, cx, cy (its
    fisheye module returns none)."""
    size = boards[0].image_size
    board = [np.column_stack([b.ij - b.ij.min(axis=0), np.zeros(len(b))]) for b in boards]
    try:
        return _opencv_fisheye(board, boards, size) if model == "fisheye" else _opencv(board, boards, size, model)
    except cv2.error as error:
        return Half(None, failure=str(error).strip().splitlines()[-1])


def _opencv(board: list[Array], boards: Sequence[Board], size: tuple[int, int], model: str) -> Half:
    none = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    flags = {"pinhole": none, "brown": 0, "rational": cv2.CALIB_RATIONAL_MODEL}[model]
    _, K, lens, _, _, std, *_ = cv2.calibrateCameraExtended(  # type: ignore[call-overload]
        [b.astype(np.float32) for b in board], [b.xy.astype(np.float32) for b in boards], size, None, None, flags=flags
    )
    many = {"pinhole": 0, "brown": 5, "rational": 8}[model]
    return Half(Camera(K, lens.ravel()[:many], size, model), std.ravel()[:CORE])  # type: ignore[arg-type]


def _opencv_fisheye(board: list[Array], boards: Sequence[Board], size: tuple[int, int]) -> Half:
    K = np.array([[0.4 * size[0], 0, (size[0] - 1) / 2], [0, 0.4 * size[0], (size[1] - 1) / 2], [0, 0, 1.0]])
    names = ("CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW", "CALIB_USE_INTRINSIC_GUESS")
    home = cv2.fisheye if hasattr(cv2.fisheye, names[0]) else cv2  # OpenCV 5 moved these flags
    flags = sum(getattr(home, n) for n in names)
    objects = [b.reshape(1, -1, 3).astype(np.float64) for b in board]
    pictures = [b.xy.reshape(1, -1, 2).astype(np.float64) for b in boards]
    _, K, lens, *_ = cv2.fisheye.calibrate(objects, pictures, size, K, np.zeros((4, 1)), flags=flags)
    return Half(Camera(K, np.ravel(lens), size, "fisheye"))


Solver = Callable[[Sequence[Board], Sequence[str], Array], Half]


def repeat(
    name: str, boards: Sequence[Board], names: Sequence[str], solver: str, solve: Solver, splits: int = SPLITS
) -> Repeatability:
    """Calibrate random halves of `boards` of pictures `names` with `solve` and compare the two. Raises RcdnError for
    too few pictures."""
    if len(set(names)) < FEWEST:
        raise RcdnError(f"set {name}: {len(set(names))} pictures with boards; halves need {FEWEST} at least")
    points = seen_area(boards)
    pairs = []
    for k in range(splits):
        both = []
        for part in halves(names, k):
            mine = [i for i, n in enumerate(names) if n in part]
            both.append(solve([boards[i] for i in mine], [names[i] for i in mine], points))
        pairs.append((both[0], both[1]))
    return _figures(name, solver, len(set(names)), points, pairs)


def _figures(name: str, solver: str, pictures: int, points: Array, pairs: list[tuple[Half, Half]]) -> Repeatability:
    squares, focal, ratios, projected, models = [], [], [], [], []
    for a, b in pairs:
        if a.camera is None or b.camera is None:
            continue
        models.append(f"{a.camera.model[0]}{b.camera.model[0]}")
        gap, _ = difference(a.camera, b.camera, points)
        squares.append(float(np.nanmean((gap**2).sum(axis=1))))
        off = a.camera.parameters[:CORE] - b.camera.parameters[:CORE]
        focal.append(off[0] / a.camera.parameters[0])
        if a.std is not None and b.std is not None:
            ratios.append(off / np.hypot(a.std, b.std))
        if a.spread is not None and b.spread is not None:
            projected.append(_projected(gap, a.spread + b.spread))
    z, p = (np.concatenate(found) if found else None for found in (ratios, projected))
    return Repeatability(
        name, solver, pictures, len(squares), len(pairs) - len(squares),
        px=_root(squares), median_px=float(np.sqrt(np.median(squares))) if squares else float("nan"),
        focal=_root([f * f for f in focal]),
        ratio=None if z is None else float(np.sqrt((z**2).mean())),
        within=None if z is None else float((np.abs(z) < 1).mean()),
        projections=None if p is None else float(np.sqrt((p**2).mean())),
        projections_within=None if p is None else float((np.abs(p) < 1).mean()),
        models=" ".join(models),
    )  # fmt: skip


def _projected(gap: Array, spread: Array) -> Array:
    """Differences (N, 2) of projections along both axes ÷ their standard deviations, flattened; points without a ray in
    either are left out."""
    z = gap / np.sqrt(np.einsum("nii->ni", spread))
    return np.asarray(z[np.isfinite(z).all(axis=1)].ravel())


def _root(squares: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(squares))) if squares else float("nan")


def row(of: Repeatability) -> dict[str, Any]:
    """As a table row."""
    return {
        "set": of.set, "solver": of.solver, "pictures": of.pictures, "splits": of.splits, "failed": of.failed,
        "px": of.px, "median px": of.median_px, "focal %": 100 * of.focal, "difference / stated": of.ratio,
        "within 1": of.within, "projections / stated": of.projections, "projections within 1": of.projections_within,
        "models": of.models,
    }  # fmt: skip


def summary(found: Sequence[Repeatability]) -> list[dict[str, Any]]:
    """A row for each solver: geometric mean of px, medians of the ratios, means of the shares, over the sets in which
    all solvers have figures."""
    solvers = list(dict.fromkeys(f.solver for f in found))
    figures = {(f.set, f.solver): f for f in found if np.isfinite(f.px)}
    sets = [s for s in dict.fromkeys(f.set for f in found) if all((s, solver) in figures for solver in solvers)]
    rows = []
    for solver in solvers:
        mine = [figures[s, solver] for s in sets]
        if not mine:
            continue
        mean = Repeatability(
            f"ALL ({len(sets)} sets)", solver, sum(f.pictures for f in mine), sum(f.splits for f in mine),
            sum(f.failed for f in mine), _geometric([f.px for f in mine]), _geometric([f.median_px for f in mine]),
            _geometric([f.focal for f in mine]), _of([f.ratio for f in mine], np.median),
            _of([f.within for f in mine], np.mean), _of([f.projections for f in mine], np.median),
            _of([f.projections_within for f in mine], np.mean), "",
        )  # fmt: skip
        rows.append(row(mean))
    return rows


def _geometric(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values))))


def _of(values: Sequence[float | None], mean: Callable[[Any], Any]) -> float | None:
    known = [v for v in values if v is not None]
    return float(mean(known)) if known else None
