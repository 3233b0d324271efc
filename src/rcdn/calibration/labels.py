"""The size of a board and consistent labels in pictures that show it whole, rotated, or in part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import a_board
from rcdn.geometry import apply_homography, homography
from rcdn.geometry.part import labels_of
from rcdn.types import SQUARES, Array, Board, Plane, Target
from rcdn.types.arrays import Real

Size = tuple[int, int]
GRID = 0.25
"""median distance of corners from a homography of the grid, in squares, above which labels are wrong: distortion causes
smaller distances"""


@dataclass(frozen=True, eq=False)
class Labelled:
    """Labels `ij` (M, 2) of a board's corners, on the whole board if `settled`, otherwise on the part seen; `reason`:
    why it cannot be used.

    `plane` of the labels, with sides of `spacing` m; the `target` identified by codes; `main`: whether the board is the
    one that most views show.
    """

    ij: Array
    settled: bool
    reason: str = ""
    plane: Plane = SQUARES
    spacing: float = 1.0
    target: Target | None = None
    main: bool = True

    @property
    def places(self) -> Real[Array, "m 2"]:
        """(M, 2) m: positions of the corners on the printed plane."""
        return self.plane.points(self.ij) * self.spacing


def label_of(board: Board, size: Size | None, strict: bool, dark: bool | None) -> Labelled:
    """Labels of a plain board on the whole board of `size` (columns, rows), None if unknown.

    They are settled if the whole board is seen, holes included, also in a picture turned by a quarter, or a part that
    the picture's border cut so that it has one place (`rcdn.geometry.part.labels_of`; `dark`: the common colour of
    whole boards there). Another part may be anywhere, and keeps its own labels, as does a board that cannot be part of
    the whole, unless it is refused because of `strict` (the user gave the size).
    """
    if not len(board):
        return Labelled(board.ij, False)
    own = board.ij - board.ij.min(axis=0)
    if size is None or board.pattern != "checker":  # the extent of a deltille is unknown, and it has no quarter turns
        return Labelled(own, False)
    whole = labels_of(board, size, dark)
    if whole is not None:
        return Labelled(whole, True)
    if strict and not fits(board.size, size):
        there = "{}×{}".format(*board.size)
        return Labelled(own, False, f"its {there} corners can't be part of {a_board(size)}")
    return Labelled(own, False)


def fits(size: Size, whole: Size) -> bool:
    """True if a board of `size` may be part of one of size `whole`, upright or turned."""
    return all(a <= b for a, b in zip(sorted(size), sorted(whole), strict=True))


def mirrored(board: Board) -> bool:
    """True if the labels' axes have the opposite handedness to x and y in the picture, which no picture of a board from
    its front has.

    False if the labels are not consistent with a grid.
    """
    H = homography(board.ij, board.xy)
    middle = board.ij.mean(axis=0)
    origin, right, below = apply_homography(H, middle + np.array([[0, 0], [0.5, 0], [0, 0.5]]))
    (a, b), (c, d) = right - origin, below - origin
    turn = a * d - b * c
    miss = np.median(np.linalg.norm(apply_homography(H, board.ij) - board.xy, axis=1))
    return bool(turn < 0 and miss < GRID * 2 * np.sqrt(-turn))
