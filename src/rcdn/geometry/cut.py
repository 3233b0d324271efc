"""Which ends of a grid may be cut by the picture's border, so that it is a part of a larger board."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array, Board, usual_size
from rcdn.types.arrays import Bool, Real

Side = Literal["left", "right", "upper", "lower"]
SIDES: tuple[Side, ...] = ("left", "right", "upper", "lower")

LINES = 3
"""rows or columns nearest to a side from which its continuation is extrapolated: distortion makes those farther away
unsuitable"""
NEAR, NEAR_PX = 0.2, 4.0
"""margin in squares, and at least in px: a corner closer to the border cannot be detected"""
HIDDEN = 0.7
"""share of the next line's corners that must lie beyond the border: if the board continued, the others would have been
detected"""
VISIBLE = 2
"""least number of those others, where it is to be sure that the board ends"""
COVERED = 2
"""most corners that may be missing within a board though they would be visible: more are a cover"""
FEWEST = 6
"""least number of corners from which others are predicted"""


def cut_sides(ij: Real[Array, "m 2"], xy: Real[Array, "m 2"], image_size: tuple[int, int]) -> tuple[Side, ...]:
    """The borders of the picture beyond which a full grid with labels `ij` (M, 2) at `xy` (M, 2) px may continue.

    () if there are none, for grids with holes and for corners in one line. The next row or column of corners,
    extrapolated by the homography of the three nearest, would lie outside the picture or too close to its border.
    """
    if not len(ij) or len(ij) != np.prod(np.ptp(ij, axis=0) + 1) or in_line(ij, xy):
        return ()
    sides = (side for ends in _ends(ij - ij.min(axis=0), xy, image_size, 0) for side in ends if side is not None)
    return tuple(dict.fromkeys(sides))


def open_ends(ij: Real[Array, "m 2"], xy: Real[Array, "m 2"], image_size: tuple[int, int]) -> Bool[Array, "2 2"] | None:
    """Whether a board, of which the corners with labels `ij` (M, 2) at `xy` (M, 2) px were found, may continue beyond
    the picture's border: before its first and after its last column (first row), the same for its rows.

    Where it may not, the board ends: the next corners would have been found. None for corners in one line or too few,
    and if corners within the box of the labels are missing that no border hides: then others beside it may be covered,
    too.
    """
    if len(ij) < FEWEST or in_line(ij, xy):
        return None
    ij = ij - ij.min(axis=0)
    if _covered(ij, xy, image_size) > COVERED:
        return None
    return np.array([[side is not None for side in ends] for ends in _ends(ij, xy, image_size, VISIBLE)])


def in_line(ij: Real[Array, "m 2"], xy: Real[Array, "m 2"]) -> bool:
    """True if the corners, or their labels, lie in one line or point."""
    return any(np.linalg.matrix_rank(a - a.mean(axis=0), tol=1e-6) < 2 for a in (xy, ij))


def _ends(ij: Array, xy: Array, image_size: tuple[int, int], least: int) -> list[list[Side | None]]:
    """For columns and rows: the border that hides what would come before the first one, and after the last one; None if
    it would be visible: enough of it, and at least `least` corners."""
    found: list[list[Side | None]] = []
    for axis, many in enumerate(np.ptp(ij, axis=0) + 1):
        ends: list[Side | None] = []
        for place, last in ((-1, 0), (many, many - 1)):
            near = np.abs(ij[:, axis] - last) < LINES
            if near.sum() < FEWEST or in_line(ij[near], xy[near]):
                near[:] = True
            line = ij[ij[:, axis] == last].copy()
            line[:, axis] = place
            ends.append(_hidden_by(ij[near], xy[near], line, image_size, least))
        found.append(ends)
    return found


def _hidden_by(ij: Array, xy: Array, line: Real[Array, "l 2"], image_size: tuple[int, int], least: int) -> Side | None:
    """The border that hides most of the corners `line` (L, 2), labels adjacent to those of `ij`; None if enough of them
    would be visible."""
    over = _beyond(ij, xy, line, image_size)
    hidden = (over > 0).any(axis=0)
    if hidden.mean() <= HIDDEN and (~hidden).sum() >= least:
        return None
    return SIDES[int(np.argmax((over > 0).sum(axis=1) + 1e-6 * over.mean(axis=1)))]


def _beyond(ij: Array, xy: Array, more: Real[Array, "l 2"], image_size: tuple[int, int]) -> Real[Array, "4 l"]:
    """(4, L) px, by how much each of SIDES hides corners with labels `more` (L, 2), predicted by the homography of
    `ij`; negative where they would be visible."""
    H = homography(ij, xy)
    beyond = apply_homography(H, more)
    step = np.linalg.norm(
        beyond - apply_homography(H, more + np.sign(ij.mean(axis=0) - more.mean(axis=0)).astype(int)), axis=1
    )
    margin = np.maximum(NEAR * step, NEAR_PX)
    width, height = image_size
    x, y = beyond.T
    return np.stack([margin - x, x - (width - 1 - margin), margin - y, y - (height - 1 - margin)])


def _covered(ij: Array, xy: Array, image_size: tuple[int, int]) -> int:
    """Number of labels that are missing in the box of `ij`, next to others, and would be visible."""
    cols, rows = (int(v) + 1 for v in ij.max(axis=0))
    known = np.zeros((rows + 2, cols + 2), bool)
    known[ij[:, 1] + 1, ij[:, 0] + 1] = True
    beside = known[:-2, 1:-1] | known[2:, 1:-1] | known[1:-1, :-2] | known[1:-1, 2:]
    count = 0
    for row, col in np.argwhere(beside & ~known[1:-1, 1:-1]):
        near = np.abs(ij - (col, row)).max(axis=1) < LINES
        if near.sum() >= FEWEST and not in_line(ij[near], xy[near]):
            count += bool((_beyond(ij[near], xy[near], np.array([(col, row)]), image_size) < 0).all())
    return count


def may_be_cut(board: Board) -> bool:
    """True if `board` is a full grid but may be the visible part of a larger board cut by the picture's border."""
    return board.pattern == "checker" and board.complete and bool(cut_sides(board.ij, board.xy, board.image_size))


def whole_size(boards: Sequence[Board]) -> tuple[int, int] | None:
    """(columns, rows) of the whole board: the most frequent size of the complete boards that no border can have cut.

    If all may be cut: their size, if it is the same for all, because a border cuts differently in every picture. None
    if it is undetermined.
    """
    cut = [may_be_cut(b) for b in boards]
    if size := usual_size([b for b, c in zip(boards, cut, strict=True) if not c]):
        return size
    sizes = {tuple(sorted(b.size)) for b, c in zip(boards, cut, strict=True) if c}
    return usual_size(boards) if len(sizes) == 1 else None


def cut_text(ij: Array, xy: Array, image_size: tuple[int, int], whole: tuple[int, int]) -> str:
    """`8×6 seen, cut by the left border`, for a full grid smaller than the `whole` board; "" if it is not cut."""
    cols, rows = (int(v) + 1 for v in ij.max(axis=0) - ij.min(axis=0))
    if sorted((cols, rows)) == sorted(whole) or not (sides := cut_sides(ij, xy, image_size)):
        return ""
    return f"{cols}×{rows} seen, cut by the {' and the '.join(sides)} border"
