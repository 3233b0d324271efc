"""The layout of a ChArUco board: which marker lies in which square. Every second square has a marker, numbered row by
row."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array, Charuco

QUADRANTS = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
"""squares around a corner, as offsets from its upper left one"""


def odd_markers(board: Charuco) -> bool:
    """Whether the markers lie in the squares whose column + row is odd; otherwise where it is even."""
    return not board.legacy


def markers_in(board: Charuco, square: Array) -> tuple[Array, Array]:
    """The numbers (...) of the markers in the squares (..., 2), column and row, and whether these squares have markers
    at all."""
    odd = odd_markers(board)
    index = index_of(square[..., 0], square[..., 1], np.array(board.columns), np.array(odd))
    return board.first_id + index, np.asarray(square.sum(axis=-1) % 2 == odd)


def most_rows(board: Charuco, markers: int) -> int:
    """The largest number of rows of squares for which there are enough `markers` in the dictionary's family."""
    return int(place_of(np.array(markers - board.first_id), np.array(board.columns), np.array(odd_markers(board)))[1])


def place_of(index: Array, columns: Array, odd: Array) -> tuple[Array, Array]:
    """(column, row) of the square with the marker `index`, counted from 0, of boards with `columns` squares per row.

    `odd`: whether the markers lie in the squares whose column + row is odd; otherwise where it is even.
    """
    first = _in_first_row(columns, odd)
    pair, rest = index // columns, index % columns  # two rows together have `columns` markers
    second = rest >= first
    row = 2 * pair + second
    return 2 * (rest - second * first) + (row + odd) % 2, row


def index_of(column: Array, row: Array, columns: Array, odd: Array) -> Array:
    """The marker, counted from 0, in the square (column, row); the inverse of `place_of`."""
    return np.asarray(row // 2 * columns + row % 2 * _in_first_row(columns, odd) + column // 2)


def _in_first_row(columns: Array, odd: Array) -> Array:
    return np.where(odd, columns // 2, (columns + 1) // 2)
