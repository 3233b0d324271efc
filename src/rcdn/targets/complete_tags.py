"""Search for missing corners of an AprilGrid whose codes were read, at the positions where its print has them.

As on boards of squares (`complete`), two edges must cross where the neighbours predict a corner; the steps to its
neighbours are those of the gap, within which each corner looks like one of a checkerboard.
"""

from __future__ import annotations

import numpy as np

from rcdn.boards.alternating import corner_and_gaps
from rcdn.boards.local import Grid, Predictions
from rcdn.geometry.division import division_of
from rcdn.targets.complete import ROUNDS, add_visible, typical_strength, with_corners
from rcdn.types import AprilGrid, Array, Board
from rcdn.types.arrays import Int
from rcdn.types.plane import plane_points

NEIGHBOURS = 12
"""corners that predict one"""
REACH = 2.4
"""largest distance of these from it, sides of a tag"""
LEAST_NEIGHBOURS = 8
"""least number of them"""
LEAST_GAP = 3.0
"""px: in smaller gaps edges can't be seen"""
OFF = 0.2
"""largest offset from the prediction, gaps"""
ASTRAY, TIMES = 0.25, 6.0
"""largest distance of a corner from its neighbours' prediction: in gaps, and × the median
distance, whichever is more"""


def completed_tags(grey: Array, board: Board, target: AprilGrid) -> Board:
    """The decoded `board` with the corners added that are visible, within its print, where the others predict them, and
    without those that the others contradict.

    `grey` (H, W), 0..255, contiguous.
    """
    print_ = _Print(target.gap, board.image_size)
    grid = Grid({(u, v): k for k, (u, v) in enumerate(board.ij.tolist())}, board.xy)
    known = grid.labels
    guess = print_.predictions(grid, known)
    at, near = _sensible(guess), np.linalg.norm(guess.xy - grid.xy[grid.corners], axis=1) / guess.pitch
    sign, typical = typical_strength(grey, known[at], guess.take(at))
    if sign == 0:
        return board
    limit = max(ASTRAY, TIMES * float(np.nanmedian(near)))
    for k in np.flatnonzero(near > limit).tolist():
        del grid.at[tuple(known[k].tolist())]
    for _ in range(ROUNDS):
        spots = _missing(grid, board, target)
        guess = print_.predictions(grid, spots)
        some = _sensible(guess)
        if not add_visible(grey, grid, spots[some], guess.take(some), sign, typical, OFF):
            break
    return with_corners(board, grid)


def _missing(grid: Grid, board: Board, target: AprilGrid) -> Int[Array, "k 2"]:
    """The labels (K, 2) of the print, where its extent isn't known of those seen, that `grid` lacks."""
    rows = 2 * target.rows - 1 if target.rows else int(board.ij[:, 1].max())
    low = 0 if target.rows else int(board.ij[:, 1].min())
    every = [(i, j) for j in range(low, rows + 1) for i in range(2 * target.columns)]
    return np.array([at for at in every if at not in grid.at], np.int64).reshape(-1, 2)


def _sensible(guess: Predictions) -> Int[Array, " k"]:
    return np.flatnonzero((guess.support >= LEAST_NEIGHBOURS) & (guess.pitch >= LEAST_GAP))


class _Print:
    """Where corners of a print with gaps of `gap` sides of a tag are in a picture of
    `image_size` (width, height) px."""

    def __init__(self, gap: float, image_size: tuple[int, int]) -> None:
        self._gap, self._image_size = gap, image_size

    def predictions(self, grid: Grid, spots: Int[Array, "k 2"]) -> Predictions:
        """Corners at the labels `spots` (K, 2), predicted from those of `grid` around them, themselves left out, by
        local homographies under the lens that the grid shows; NaN with the support 0 where there are too few."""
        labels, xy = grid.labels, grid.xy[grid.corners]
        printed, wanted = (plane_points(ij, "aprilgrid", self._gap) for ij in (labels, spots))
        lens = division_of(printed, xy, self._image_size)
        flat = xy if lens is None else lens.undistorted(xy)
        out = Predictions(np.full((len(spots), 6), np.nan), np.zeros(len(spots), np.int64), np.full(len(spots), np.nan))
        for k, here in enumerate(wanted):
            far = np.abs(printed - here).max(axis=1)
            far[(labels == spots[k]).all(axis=1)] = np.inf
            near = np.argsort(far, kind="stable")[:NEIGHBOURS]
            near = near[far[near] < REACH]
            if len(near) < LEAST_NEIGHBOURS or np.ptp(labels[near], axis=0).min() == 0:
                continue
            found = corner_and_gaps(printed[near] - here, flat[near], self._gap, lens)
            if found is not None and np.isfinite(found).all():
                steps = found[1:] - found[0]
                out.maps[k], out.support[k] = np.concatenate([found[0], *steps]), len(near)
                out.pitch[k] = np.linalg.norm(steps, axis=1).min()
        return out
