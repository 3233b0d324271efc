"""Separates boards of which one lies over another, and which a few links have joined into one lattice.

Such a lattice lies in two planes that meet in a narrow neck; a single board, bent or seen through a wide lens, lies in
none exactly, and a folded one in two that meet along a whole line of its corners.
"""

from __future__ import annotations

import numpy as np

from rcdn.boards.local import Grid, parts, windows
from rcdn.boards.validate import is_full
from rcdn.geometry.division import division_of
from rcdn.geometry.homography import apply_homographies, homography
from rcdn.geometry.rules import CHECKER
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

LEAST_CORNERS = 20
"""fewest corners of a grid that may be two boards"""
BENT = 0.2
"""squares: RMS distance from the best plane, up to which a grid is one board"""
NEAR, EXACT = 0.12, 0.035
"""squares: distance up to which a corner is of a plane, and the RMS of those that are, up to which they are a flat
board's"""
TOGETHER = 0.95
"""least share of the grid's corners that two planes must have"""
NECK = 0.5
"""most edges between the two, share of the shorter side of the smaller: a fold crosses them all"""
SEEDS, ROUNDS = 40, 4
"""blocks of 3 × 3 corners from which a plane is grown, and how often it is fitted to what is near it"""
FEWEST = 9
"""fewest corners of a plane"""


def separated(grid: Grid, image_size: tuple[int, int]) -> list[Grid]:
    """The grid, or the two flat boards that it consists of, without the corners of neither. `image_size` (width,
    height) px of the image with the grid."""
    labels, xy = grid.labels, grid.xy[grid.corners]
    if len(grid) < LEAST_CORNERS or is_full(grid):
        return [grid]
    if _misfit(labels, xy, image_size) <= BENT:
        return [grid]
    first = _plane(labels, xy)
    rest = np.flatnonzero(~first)
    if not first.any() or len(rest) < FEWEST:
        return [grid]
    second = np.zeros(len(labels), bool)
    second[rest] = _plane(labels[rest], xy[rest])
    if not second.any():
        return [grid]
    first, second = _nearer(labels, xy, first, second)
    if first.sum() + second.sum() < TOGETHER * len(labels) or min(first.sum(), second.sum()) < FEWEST:
        return [grid]
    if any(_rms(labels[some], xy[some]) > EXACT for some in (first, second)):
        return [grid]
    shorter = min(int((np.ptp(labels[some], axis=0) + 1).min()) for some in (first, second))
    if _edges(labels, first, second) > NECK * shorter:
        return [grid]
    items = list(grid.at.items())
    return [Grid(dict(items[k] for k in np.flatnonzero(some)), grid.xy) for some in (first, second)]


def _misfit(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], image_size: tuple[int, int]) -> float:
    """RMS distance of corners from their places in the best plane, squares, without a lens's radial distortion if that
    explains it."""
    plain = _rms(labels, xy)
    if plain <= BENT:
        return plain
    lens = division_of(labels.astype(float), xy, image_size)
    return plain if lens is None else min(plain, _rms(labels, lens.undistorted(xy)))


def _plane(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"]) -> Bool[Array, " m"]:
    """(M,) bool: the connected corners of the plane that has the most; none if there is no block of 3 × 3 corners."""
    blocks = windows(labels, labels, 1)
    blocks = blocks[(blocks >= 0).all(axis=1)]
    blocks = blocks[:: max(1, -(-len(blocks) // SEEDS))]
    planes = np.zeros((len(blocks), len(labels)), bool)
    np.put_along_axis(planes, blocks, True, axis=1)
    for _ in range(ROUNDS):
        planes = _distances(labels, xy, planes) <= NEAR
        planes = planes[planes.sum(axis=1) >= FEWEST]
    if not len(planes):
        return np.zeros(len(labels), bool)
    best = planes[planes.sum(axis=1).argmax()]
    largest = parts(map(tuple, labels[best].tolist()), CHECKER.steps)[0]
    return best & np.array([tuple(label) in largest for label in labels.tolist()])


def _nearer(
    labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], first: Bool[Array, " m"], second: Bool[Array, " m"]
) -> tuple[Bool[Array, " m"], Bool[Array, " m"]]:
    """(M,) bool twice: which corners are of either plane, each of the one that it is nearer to."""
    distances = _distances(labels, xy, np.stack([first, second]))
    of = np.where(distances.min(axis=0) <= NEAR, distances.argmin(axis=0), -1)
    return of == 0, of == 1


def _distances(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], planes: Bool[Array, "k m"]) -> Real[Array, "k m"]:
    """(K, M) squares: distances of all corners from their places in the plane through some of them, in each of K
    planes."""
    H = np.array([homography(xy[some], labels[some].astype(float)) for some in planes]).reshape(-1, 3, 3)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        gaps = np.linalg.norm(apply_homographies(H, xy) - labels, axis=2)
    return np.where(np.isfinite(gaps), gaps, np.inf)


def _rms(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"]) -> float:
    """RMS distance of corners from their places in the plane through all of them, squares."""
    return float(np.sqrt((_distances(labels, xy, np.ones((1, len(labels)), bool)) ** 2).mean()))


def _edges(labels: Int[Array, "m 2"], first: Bool[Array, " m"], second: Bool[Array, " m"]) -> int:
    """Number of neighbours of which one is in the `first` part (M,) and one in the `second` (M,)."""
    rows = windows(labels, labels[first], 1)[:, [1, 3, 5, 7]]
    return int(second[rows[rows >= 0]].sum())
