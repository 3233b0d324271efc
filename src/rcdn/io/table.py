"""A table of the corners of boards as CSV (docs/formats.md), for spreadsheets and other programs: written only."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import numpy as np

from rcdn.io.files import write_chunks
from rcdn.io.formats import DECIMALS, ImageResult, rounded
from rcdn.types import Board

COLUMNS = ("picture", "board", "i", "j", "x", "y", "sigma", "id")


def write_csv(path: str | Path, images: Iterable[ImageResult]) -> None:
    """Write a line `picture,board,i,j,x,y,sigma,id` for each corner of each board, whole or not at all, below a line of
    these names.

    `board`: number of the board in its picture, from 0; `i`, `j`: column and row of the corner; `x`, `y` px; `sigma`:
    standard deviation of the position, px; `id`: number of the corner on a coded target. Positions and deviations have
    4 decimals; what isn't known is empty. Corners outside boards, and pictures without a board, have no line. UTF-8;
    what of a file's name isn't, is written as \\udc80 to \\udcff. `images` may be lazy. Raises OutputError as
    `write_text`.
    """
    write_chunks(path, chain((_line(COLUMNS),), map(_lines, images)))


def _lines(image: ImageResult) -> bytes:
    return b"".join(
        _line((image.path, number, *corner)) for number, board in enumerate(image.boards) for corner in _corners(board)
    )


def _corners(board: Board) -> Iterable[tuple[object, ...]]:
    """i, j, x, y, deviation and number of each corner; "" for what isn't known."""
    sigma = np.full(len(board), np.nan) if board.sigma is None else board.sigma
    ids = [""] * len(board) if board.ids is None else board.ids.tolist()
    places = zip(board.ij.tolist(), rounded(board.xy).tolist(), rounded(sigma).tolist(), ids, strict=True)
    for (i, j), (x, y), deviation, number in places:
        yield i, j, _number(x), _number(y), "" if deviation != deviation else _number(deviation), number


def _number(value: float) -> str:
    return f"{value:.{DECIMALS}f}"


def _line(fields: Iterable[object]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(fields)
    return text.getvalue().encode("utf-8", "backslashreplace")
