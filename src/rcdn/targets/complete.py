"""Search for missing corners of a board whose codes were read, at the positions where its print has them.

The codes determine the position and the extent of the board, so that a corner is accepted if two edges cross at the
position that its neighbours predict: neither the network nor a candidate is needed. Where no edges cross, the corner
stays missing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.boards.edges import crossings
from rcdn.boards.fill import with_sense
from rcdn.boards.local import Grid, Predictions
from rcdn.boards.validate import predicted_excess
from rcdn.geometry import apply_homography, homography
from rcdn.targets.families import family_of
from rcdn.targets.layout import QUADRANTS, markers_in, most_rows
from rcdn.types import Array, Board, Charuco, Status
from rcdn.types.arrays import Bool, Real, Shaped

ROUNDS = 12
"""of completion, at most"""
SEEN = 0.3
"""least strength of both edges, share of the median on the board"""
OFF = 0.14
"""largest offset from the prediction, squares"""
LEAST_CORNERS = 6
"""least number of corners of a board that can predict others"""
ASTRAY, TIMES = 0.05, 6.0
"""largest distance of a corner from the smooth surface through all of them: in squares, and × the median distance,
whichever is more"""
SURFACE = 16
"""least number of corners for the fit of such a surface"""
CUBIC = 40
"""least number of corners for a surface of degree 3; otherwise its degree is 2"""
ROW_CORNERS, ROW_SHARE = 4, 0.5
"""least number and share of a row's corners with which a board of unknown rows has a row below those that were read
(with one corner, one of 1,020 photographs and frames had a corner beyond its board)"""


def completed(grey: Shaped[Array, "h w"], board: Board) -> Board:
    """The decoded `board`, with the corners added that are visible, within its print, where the others predict them,
    and without outliers.

    `grey` (H, W), 0..255.
    """
    if board.pattern != "checker" or len(board) < LEAST_CORNERS:
        return board
    grey = np.ascontiguousarray(grey)
    grid = Grid({(u, v): k for k, (u, v) in enumerate(board.ij.tolist())}, board.xy)
    _drop_astray(grid)
    if len(grid) == len(board) and _is_whole(board):
        return board
    _drop_misfits(grid)
    if len(grid) < LEAST_CORNERS:
        return board
    known = grid.labels
    guess = grid.predictions(known)
    sense = with_sense(guess)
    sign, typical = typical_strength(grey, known[sense], guess.take(sense))
    if sign == 0:
        return board
    for _ in range(ROUNDS):
        spots, guess = grid.beside()
        some = np.intersect1d(with_sense(guess), np.flatnonzero(_printed(board, spots)))
        if not add_visible(grey, grid, spots[some], guess.take(some), sign, typical, OFF):
            break
    _drop_astray(grid)
    _drop_unlikely_rows(board, grid)
    return with_corners(_with_all_markers(board, grid.labels), grid)


def _printed(board: Board, spots: Real[Array, "k 2"]) -> Bool[Array, " k"]:
    """(K,) bool: whether the labels `spots` (K, 2) lie within the print; of a PuzzleBoard, whose extent isn't known,
    within the labels seen. A ChArUco board of unknown rows has as many as show corners."""
    low, high = board.ij.min(axis=0), board.ij.max(axis=0)
    if isinstance(board.target, Charuco):
        low = np.zeros(2, int)
        rows = board.target.rows or most_rows(board.target, len(family_of(board.target.dictionary)))
        high = np.array([board.target.columns - 2, rows - 2])
    return np.asarray(((spots >= low) & (spots <= high)).all(axis=1))


def _drop_unlikely_rows(board: Board, grid: Grid) -> None:
    """Drop the corners, in place, of rows below those that were read, from the first row on that shows less than
    `ROW_SHARE` of its corners or fewer than `ROW_CORNERS`: where a board ends, an edge may cross another by chance."""
    if not isinstance(board.target, Charuco) or board.target.rows is not None:
        return
    per_row = board.target.columns - 1
    row = int(board.ij[:, 1].max()) + 1
    while sum(v == row for _, v in grid.at) >= max(ROW_CORNERS, ROW_SHARE * per_row):
        row += 1
    grid.at = {spot: corner for spot, corner in grid.at.items() if spot[1] < row}


def _with_all_markers(board: Board, ij: Array) -> Board:
    """The board with a dictionary that has all markers around corners with the labels `ij` (N, 2)."""
    target = board.target
    if not isinstance(target, Charuco):
        return board
    marker, marked = markers_in(target, ij[:, None] + QUADRANTS)
    family = family_of(target.dictionary)
    needed = family.smallest(min(int(marker[marked].max()), len(family) - 1))
    if family.names.index(needed) <= family.names.index(target.dictionary):
        return board
    return replace(board, target=replace(target, dictionary=needed))


def _is_whole(board: Board) -> bool:
    """Whether a board has all corners of its print; of a PuzzleBoard, of its bounding grid."""
    columns, rows = board.ij.max(axis=0) - board.ij.min(axis=0) + 1
    if isinstance(board.target, Charuco):
        if board.target.rows is None:
            return False
        columns, rows = board.target.columns - 1, board.target.rows - 1
    return len(board) >= columns * rows


def _drop_misfits(grid: Grid) -> None:
    """Drop corners, in place, that are too far from their neighbours' prediction, the worst first."""
    while len(grid) >= LEAST_CORNERS:
        spots = list(grid.at)
        excess = predicted_excess(grid, spots)
        excess = np.where(excess == 2, 0, excess)  # neighbours that give no prediction
        if excess.max() <= 1:
            return
        del grid.at[spots[int(excess.argmax())]]


def _drop_astray(grid: Grid) -> None:
    """Drop corners, in place, that are outliers of the smooth surface through all of them, the worst first: there the
    edges of an occluder cross."""
    while len(grid) >= SURFACE:
        off = _off_surface(grid.labels, grid.xy[grid.corners])
        worst = int(off.argmax())
        if off[worst] <= max(ASTRAY, TIMES * float(np.median(off))):
            return
        del grid.at[list(grid.at)[worst]]


def _off_surface(ij: Array, xy: Real[Array, "n 2"]) -> Real[Array, " n"]:
    """Distances (N,), squares, of corners at `xy` (N, 2) px from a homography of their labels plus a polynomial of low
    degree."""
    plane = homography(ij, xy)
    flat = apply_homography(plane, ij.astype(float))
    steps = [apply_homography(plane, ij + step) - flat for step in np.eye(2)]
    area = np.abs(steps[0][:, 0] * steps[1][:, 1] - steps[0][:, 1] * steps[1][:, 0])
    u, v = (2 * (ij - ij.min(axis=0)) / np.maximum(np.ptp(ij, axis=0), 1) - 1).T
    degree = 3 if len(ij) >= CUBIC else 2
    terms = np.stack([u**a * v**b for a in range(degree + 1) for b in range(degree + 1 - a)], axis=1)
    left = xy - flat
    left = left - terms @ np.linalg.lstsq(terms, left, rcond=None)[0]
    return np.asarray(np.linalg.norm(left, axis=1) / np.sqrt(np.maximum(area, 1e-9)))


def typical_strength(grey: Array, at: Real[Array, "k 2"], guess: Predictions) -> tuple[int, Array]:
    """The colouring, ±1, for which edges cross at known corners `at` (K, 2), and the median strengths (2,) of these
    edges; 0 if they cross for neither."""
    best, typical = 0, np.zeros(2)
    for sign in (-1, 1):
        if len(at):
            strength = np.median(_crossings(grey, at, guess, sign)[1], axis=0)
            if strength.min() > typical.min():
                best, typical = sign, strength
    return best, typical


def _crossings(grey: Array, at: Array, guess: Predictions, sign: int) -> tuple[Array, Array]:
    colour = sign * (1.0 - 2 * (at.sum(axis=1) % 2))
    return crossings(grey, guess.xy, guess.du, guess.dv, colour)


def add_visible(
    grey: Array, grid: Grid, at: Real[Array, "k 2"], guess: Predictions, sign: int, typical: Array, most_off: float
) -> bool:
    """Add to `grid`, in place, the corners at those labels of `at` (K, 2) where both edges visibly cross, at most
    `most_off` of a step from their predictions; whether there are any."""
    if not len(at):
        return False
    offset, strength = _crossings(grey, at, guess, sign)
    xy = guess.xy + offset[:, :1] * guess.du + offset[:, 1:] * guess.dv
    inside = ((xy >= 1) & (xy <= np.array(grey.shape[::-1]) - 2)).all(axis=1)
    fine = inside & (np.abs(offset).max(axis=1) <= most_off) & (strength >= SEEN * typical).all(axis=1)
    grid.at |= {(u, v): len(grid.xy) + k for k, (u, v) in enumerate(at[fine].tolist())}
    grid.xy = np.concatenate([grid.xy, xy[fine]])
    return bool(fine.any())


def with_corners(board: Board, grid: Grid) -> Board:
    """The board with the corners of a grid, in which the board's own positions come first."""
    ij, index = grid.labels, grid.corners
    order = np.lexsort((ij[:, 0], ij[:, 1]))
    ij, index = ij[order], index[order]
    old = index < len(board)
    own = np.where(old, index, 0)
    target = board.target
    return replace(
        board, xy=grid.xy[index], ij=ij, response=np.where(old, board.response[own], 0.0),
        status=np.where(old, board.status[own], np.uint8(Status.COMPLETED)),
        sigma=None if board.sigma is None else np.where(old, board.sigma[own], np.nan),
        ids=None if target is None else target.ids(ij),
    )  # fmt: skip
