"""One board's size and labels across pictures that show it whole, turned, or in part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array, Board, Charuco, Orientation, Target

Size = tuple[int, int]
GRID = 0.25
"""squares that the typical corner of a grid may lie off a plane's homography: lenses bend it, shuffled labels tear it"""


@dataclass(frozen=True, eq=False)
class Labelled:
    """Labels `ij` (M, 2) of a board's corners, of the whole board if `settled`, else of the part seen; `reason`: why it can't be used."""

    ij: Array
    settled: bool
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Coded:
    """The coded target of a set of boards: `size` (columns, rows) of its corners as far as they are seen, the `first` of which is at that place."""

    target: Target
    first: Array
    size: Size

    @classmethod
    def of(cls, boards: Sequence[Board]) -> Coded | None:
        """The target that most of the coded boards are of; None if there are none."""
        usual = Counter(_identity(b.target) for b in boards if b.target is not None)
        if not usual:
            return None
        most = max(usual, key=lambda t: usual[t])
        mine = [b for b in boards if b.target is not None and _identity(b.target) == most]
        low, high = np.min([b.ij.min(axis=0) for b in mine], axis=0), np.max([b.ij.max(axis=0) for b in mine], axis=0)
        known = [b.target.rows for b in mine if isinstance(b.target, Charuco) and b.target.rows]
        if isinstance(most, Charuco):
            low, high = np.zeros(2, int), np.array([most.columns - 2, max(known) - 2 if known else high[1]])
        return cls(most, low, (int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1))

    def label(self, board: Board) -> Labelled:
        """Labels of a coded board on the whole target."""
        if board.target is None or _identity(board.target) != self.target:
            return Labelled(board.ij, False, f"it shows another target: {board.target}")
        return Labelled(board.ij - self.first, True)


def _identity(target: Target) -> Target:
    """What is the same in all views of one target: not its measured proportions, nor how much of it was seen."""
    return replace(target, rows=None, marker=0.5) if isinstance(target, Charuco) else target


def settle(boards: Sequence[Board], size: Size | None, strict: bool, coded: Coded | None = None) -> list[Labelled]:
    """Labels of each board in a whole board of `size` (columns, rows).

    A board whose box has that size, holes included, is settled; one that lies the other way is turned a quarter, so that the square inside (0, 0)
    keeps its colour. A smaller one may lie anywhere in the whole: it keeps its own labels. What can't be part of the whole
    keeps them, too, or is refused if `strict` (the user named the size). `coded`: the target that some boards' codes name; these have its labels.
    """
    return [
        coded.label(b) if coded and b.target is not None else _label(b, size, strict, coded is None) for b in boards
    ]


def orientation_of(size: Size) -> Orientation:
    """Whether colours settle which corner of a whole board is (0, 0): docs/conventions.md."""
    cols, rows = size
    if (cols + rows) % 2:
        return "unique"
    return "ambiguous_90" if cols == rows and cols % 2 == 0 else "ambiguous_180"


def _label(board: Board, size: Size | None, strict: bool, alone: bool) -> Labelled:
    """`alone`: no other board's codes say which corner is which, so that a board that looks the same when it is turned may be labelled as it lies."""
    if not len(board):
        return Labelled(board.ij, False)
    own = board.ij - board.ij.min(axis=0)
    if size is None or board.pattern != "checker":  # where a deltille ends isn't known, and it has no quarter turns
        return Labelled(own, False)
    if not alone and orientation_of(board.size) != "unique":
        return Labelled(own, False)
    if board.size == size:
        return Labelled(own, True)
    if board.size == size[::-1]:
        # the quarter turn that leaves the square inside (0, 0) its colour, as `Board.grid_of` does
        return Labelled(turn_labels(own, board.size, 1 if board.size[0] % 2 == 0 else 3), True)
    if strict and not fits(board.size, size):
        there, whole = ("{}×{}".format(*s) for s in (board.size, size))
        return Labelled(own, False, f"its {there} corners can't be part of a {whole} board")
    return Labelled(own, False)


def fits(size: Size, whole: Size) -> bool:
    """True if a board of `size` may be part of one of size `whole`, upright or turned."""
    return all(a <= b for a, b in zip(sorted(size), sorted(whole), strict=True))


def turn_labels(ij: Array, size: Size, turn: int) -> Array:
    """Labels (N, 2) of a board of `size` after `turn` quarters."""
    for _ in range(turn):
        ij = np.stack([ij[:, 1], size[0] - 1 - ij[:, 0]], axis=-1)
        size = (size[1], size[0])
    return ij


def in_line(board: Board) -> bool:
    """True if the corners, or their labels, lie in one line or point."""
    return any(np.linalg.matrix_rank(a - a.mean(axis=0), tol=1e-6) < 2 for a in (board.xy, board.ij))


def mirrored(board: Board) -> bool:
    """True if columns × rows of a board don't turn like x × y: no picture of a board from its front gives that.

    False if its labels make no grid at all.
    """
    H = homography(board.ij, board.xy)
    middle = board.ij.mean(axis=0)
    origin, right, below = apply_homography(H, middle + np.array([[0, 0], [0.5, 0], [0, 0.5]]))
    (a, b), (c, d) = right - origin, below - origin
    turn = a * d - b * c
    miss = np.median(np.linalg.norm(apply_homography(H, board.ij) - board.xy, axis=1))
    return bool(turn < 0 and miss < GRID * 2 * np.sqrt(-turn))
