"""Identifies the coded target of a board, and the positions of its corners on the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rcdn.targets import quick_test
from rcdn.targets.aprilgrid import dictionary_of, read_aprilgrid
from rcdn.targets.charuco import Markers, ends_of, markers_of, may_be_mirrored, may_be_read, read_charuco
from rcdn.targets.families import family_of
from rcdn.targets.paper import ended_sides
from rcdn.targets.projected_lattice import projected_board
from rcdn.targets.puzzle import read_puzzle
from rcdn.targets.reading import Reading
from rcdn.targets.rectify import aspect_of, grid_with_ring, rectified, whole_squares, wider
from rcdn.types import AprilGrid, Array, Board, Charuco, PuzzleBoard, Target
from rcdn.types.arrays import Bool, Int, Real, Shaped

SAMPLES = 32
"""samples along a square's side"""


def identified(grey: Shaped[Array, "h w"], board: Board, given: Target | None = None, part: bool = False) -> Board:
    """The board with its `target` and `ids`, and with positions on the target as labels; the same board if no code is
    certain.

    `grey` (H, W), 0..255; `given`: the target given by the user (None: unknown); `part`: the board may extend beyond
    its corners. Wrong for at most one in a million boards whose squares contain random dots.
    """
    return identified_straight(grey, board, given, part).board


@dataclass(frozen=True, eq=False)
class Attempt:
    """A `board`, identified if its codes were certain; if they weren't, the `markers` seen, and whether they are
    `contradicted`: clearly read, but not of one board."""

    board: Board
    markers: Sequence[Markers] = ()
    contradicted: bool = False

    def mirrored(self, given: Target | None) -> bool:
        """Whether the markers may be readable in the mirror image; `given`: the target given by the user."""
        return may_be_mirrored(self.markers) if given is None else bool(self.markers)

    def enough(self, given: Target | None) -> bool:
        """Whether the markers carry enough evidence for a layout, so that exact corners may make one certain; of a
        `given` target, whether there are any."""
        return may_be_read(self.markers) if given is None else bool(self.markers)


def identified_straight(
    grey: Array, board: Board, given: Target | None = None, part: bool = False, markers: bool = True
) -> Attempt:
    """`identified`, and what may be tried if no code is certain. `markers`: try to read markers at all."""
    if board.pattern == "aprilgrid":
        return _tags(grey, board, given) if given is None or isinstance(given, AprilGrid) else Attempt(board)
    if isinstance(given, AprilGrid) or board.pattern != "checker" or min(board.size) < 2:
        return Attempt(board)
    grid, found = grid_with_ring(board)
    reading: Reading | None = None
    seen: list[Markers] = []
    if markers and not isinstance(given, PuzzleBoard):
        reading, seen = _markers(grey, grid, found, given, part)
    if reading is None and not isinstance(given, Charuco):
        reading = read_puzzle(grey, grid, found)
    if reading is None:
        return Attempt(board, seen)
    return Attempt(board, contradicted=True) if reading.contradicted else Attempt(_placed(board, reading))


def _markers(
    grey: Array, grid: Array, found: Array, given: Charuco | None, part: bool
) -> tuple[Reading | None, list[Markers]]:
    """The reading of the markers in the squares of a `grid_with_ring`, or None; and the markers."""
    inner = whole_squares(found)
    marked = quick_test.marked_squares(rectified(grey, grid, quick_test.SAMPLES), inner)
    if marked is None:
        return None, []
    seen = projected_board(grid, found, (grey.shape[1], grey.shape[0]))
    wide = rectified(grey, wider(grid), SAMPLES) if seen is None else seen.rectified(grey, SAMPLES)
    squares = wide[1:-1, 1:-1]
    lifted = squares - _dark(squares, marked, inner)[:, :, None, None]
    markers = markers_of(lifted, marked, inner, aspect_of(grid), given)
    ended = partial(ended_sides, wide, marked)
    reading = read_charuco(markers, given, None if part else ends_of(lifted, inner), ended)
    return reading, markers


def check_target(target: Target) -> None:
    """Raises ConfigError unless the target can be read."""
    if isinstance(target, Charuco):
        family_of(target.dictionary)
    elif isinstance(target, AprilGrid):
        dictionary_of(target.family)


def _dark(squares: Array, marked: Array, inner: Array) -> Real[Array, "r c"]:
    """Grey level (R, C) of the squares without markers adjacent to each square, the mean of up to four; the board's
    median where there is none."""
    part = slice(SAMPLES * 3 // 8, SAMPLES * 5 // 8)
    level = squares[:, :, part, part].mean(axis=(2, 3))
    usable = ~marked & np.isfinite(level)
    usable &= inner | ~(usable & inner).any()
    padded = np.pad(np.where(usable, level, np.nan), 1, constant_values=np.nan)
    beside = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    known = np.isfinite(beside)
    mean = np.where(known, beside, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known.any(axis=0), mean, np.median(level[usable]))


def _tags(grey: Array, board: Board, given: AprilGrid | None) -> Attempt:
    """A lattice of tags, labelled as an AprilGrid if its numbering is certain."""
    columns, rows = (2 * (n // 2 + 1) for n in board.ij.max(axis=0).tolist())
    grid, index = np.full((rows, columns, 2), np.nan), np.full((rows, columns), -1)
    i, j = board.ij.T
    grid[j, i], index[j, i] = board.xy, np.arange(len(board))
    reading = read_aprilgrid(grey, grid, given)
    if reading is None or reading.contradicted:
        return Attempt(board, contradicted=reading is not None)
    return Attempt(_relabelled(board, reading, index))


def _placed(board: Board, reading: Reading) -> Board:
    """A board of squares, labelled with its positions on the target."""
    columns, rows = board.size
    index = np.full((rows, columns), -1)
    i, j = (board.ij - board.ij.min(axis=0)).T
    index[j, i] = np.arange(len(board))
    return _relabelled(board, reading, index)


def _relabelled(board: Board, reading: Reading, index: Int[Array, "r c"]) -> Board:
    """The board whose grid has the corners `index` (R, C), −1 for none, rotated to the orientation of its target, with
    corners sorted row by row."""
    index, target = np.rot90(index, reading.turns), reading.target
    row, column = np.nonzero(index >= 0)
    ij = np.stack([column, row], axis=1) + np.array(reading.place)
    on_it = _on(target, ij)
    order, ij = index[row, column][on_it], ij[on_it]
    pick = lambda a: None if a is None else a[order]  # noqa: E731
    return replace(
        board, xy=board.xy[order], ij=ij, response=board.response[order], status=board.status[order],
        sigma=pick(board.sigma), orientation="unique", target=target, ids=target.ids(ij),
        origin_dark=None,
    )  # fmt: skip


def _on(target: Target, ij: Int[Array, "n 2"]) -> Bool[Array, " n"]:
    """(N,) whether the positions `ij` are corners of the target: a ChArUco board may be larger than the given one."""
    if not isinstance(target, Charuco):
        return np.ones(len(ij), bool)
    ends = [target.columns - 1, np.inf if target.rows is None else target.rows - 1]
    return np.asarray(((ij >= 0) & (ij < ends)).all(axis=1))
