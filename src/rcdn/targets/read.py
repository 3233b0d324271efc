"""Which coded target a board is, and where its corners lie on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.targets.aprilgrid import read_aprilgrid
from rcdn.targets.charuco import read_charuco
from rcdn.targets.puzzle import read_puzzle
from rcdn.targets.reading import Reading
from rcdn.targets.rectify import aspect_of, grid_with_ring, rectified, whole_squares
from rcdn.types import Array, Board

SAMPLES = 32
"""a square's side on the raster"""
GLANCE = 8
"""the same where it is only asked whether there may be markers"""
PLAIN = 0.15
"""standard deviation inside of squares, share of the contrast, under which they hold no markers"""


def identified(grey: Array, board: Board) -> Board:
    """The board with its `target` and `ids`, its labels being places on the target; the same board if it carries no code that is certain.

    `grey` (H, W), 0..255. Wrong at most once in a million boards whose squares hold random dots.
    """
    if board.pattern == "aprilgrid":
        return _tags(grey, board)
    if board.pattern != "checker" or min(board.size) < 2:
        return board
    grid, found = grid_with_ring(board)
    inner = whole_squares(found)
    marked = _marked(rectified(grey, grid, GLANCE), inner)
    reading = None
    if marked is not None:
        squares = rectified(grey, grid, SAMPLES)
        lifted = squares - _dark(squares, marked, inner)[:, :, None, None]
        reading = read_charuco(lifted, marked, inner, aspect_of(grid))
    reading = reading or read_puzzle(grey, grid, found)
    return board if reading is None else _placed(board, reading)


def _marked(squares: Array, inner: Array) -> Array | None:
    """Which squares (R, C), of one colour, hold markers; None if neither colour's squares are less plain than the other's."""
    row, column = np.indices(inner.shape)
    middle = squares[:, :, 1:-1, 1:-1]
    level, spread = middle.mean(axis=(2, 3)), middle.var(axis=(2, 3))
    colours = [(row + column) % 2 == k for k in (0, 1)]
    known = [c & inner & np.isfinite(level) for c in colours]
    if min(k.sum() for k in known) < 1:
        return None
    rim = np.concatenate(
        [squares[:, :, :1, :].reshape(*inner.shape, -1), squares[:, :, -1:, :].reshape(*inner.shape, -1)], axis=2
    ).mean(axis=2)
    contrast = abs(float(np.median(rim[known[0]])) - float(np.median(rim[known[1]])))
    noise = [float(np.median(spread[k])) for k in known]
    more = int(np.argmax(noise))
    if noise[more] - noise[1 - more] < (PLAIN * contrast) ** 2:
        return None
    return np.asarray(colours[more])


def _dark(squares: Array, marked: Array, inner: Array) -> Array:
    """Grey (R, C) of the squares without markers beside each square, mean of up to four; of the whole board where there is none."""
    part = slice(SAMPLES * 3 // 8, SAMPLES * 5 // 8)
    level = squares[:, :, part, part].mean(axis=(2, 3))
    usable = ~marked & np.isfinite(level)
    usable &= inner | ~(usable & inner).any()
    padded = np.pad(np.where(usable, level, np.nan), 1, constant_values=np.nan)
    beside = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
    known = np.isfinite(beside)
    mean = np.where(known, beside, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known.any(axis=0), mean, np.median(level[usable]))


def _tags(grey: Array, board: Board) -> Board:
    """A lattice of tags with the numbers of an AprilGrid."""
    columns, rows = (2 * (n // 2 + 1) for n in board.ij.max(axis=0).tolist())
    grid, index = np.full((rows, columns, 2), np.nan), np.full((rows, columns), -1)
    i, j = board.ij.T
    grid[j, i], index[j, i] = board.xy, np.arange(len(board))
    reading = read_aprilgrid(grey, grid)
    return board if reading is None else _relabelled(board, reading, index)


def _placed(board: Board, reading: Reading) -> Board:
    """A board of squares with its places on the target."""
    columns, rows = board.size
    index = np.full((rows, columns), -1)
    i, j = (board.ij - board.ij.min(axis=0)).T
    index[j, i] = np.arange(len(board))
    return _relabelled(board, reading, index)


def _relabelled(board: Board, reading: Reading, index: Array) -> Board:
    """The board whose grid has the corners `index` (R, C), −1 for none, turned as its target is labelled, row by row again."""
    index, target = np.rot90(index, reading.turns), reading.target
    row, column = np.nonzero(index >= 0)
    order = index[row, column]
    ij = np.stack([column, row], axis=1) + np.array(reading.place)
    pick = lambda a: None if a is None else a[order]  # noqa: E731
    return replace(
        board, xy=board.xy[order], ij=ij, response=board.response[order], status=board.status[order], sigma=pick(board.sigma),
        orientation="unique", target=target, ids=target.ids(ij),
    )  # fmt: skip
