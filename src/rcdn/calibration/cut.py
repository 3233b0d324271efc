"""Detection of complete grids that may be parts of larger boards cut by the picture's border."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array, Board, usual_size
from rcdn.types.arrays import Int, Real

Side = Literal["left", "right", "upper", "lower"]

LINES = 3
"""rows or columns nearest to a side from which its continuation is extrapolated: distortion makes those farther away
unsuitable"""
NEAR, NEAR_PX = 0.2, 4.0
"""margin in squares, and at least in px: a corner closer to the border cannot be detected"""
HIDDEN = 0.7
"""share of the next line's corners that must lie beyond the border: if the board continued, the others would have been
detected"""


def cut_sides(ij: Int[Array, "m 2"], xy: Real[Array, "m 2"], image_size: tuple[int, int]) -> tuple[Side, ...]:
    """The borders of the picture beyond which a full grid with labels `ij` (M, 2) at `xy` (M, 2) px may continue.

    () if there are none, for grids with holes and for corners in one line. The next row or column of corners,
    extrapolated by the homography of the three nearest, would lie outside the picture or too close to its border.
    """
    if not len(ij):
        return ()
    ij = ij - ij.min(axis=0)
    cols, rows = (int(v) + 1 for v in ij.max(axis=0))
    if len(ij) != cols * rows or min(cols, rows) < 2 or np.linalg.matrix_rank(xy - xy.mean(axis=0), tol=1e-6) < 2:
        return ()
    found: list[Side] = []
    for axis, many in ((0, cols), (1, rows)):
        for place, last in ((-1, 0), (many, many - 1)):
            near = np.abs(ij[:, axis] - last) < LINES
            line = ij[ij[:, axis] == last].copy()
            line[:, axis] = place
            found += _hidden_by(ij[near], xy[near], line, image_size)
    return tuple(dict.fromkeys(found))


def _hidden_by(ij: Array, xy: Array, line: Real[Array, "l 2"], image_size: tuple[int, int]) -> list[Side]:
    """The border that hides most of the corners `line` (L, 2), labels adjacent to those of `ij`; [] if they would be
    visible."""
    H = homography(ij, xy)
    beyond = apply_homography(H, line)
    step = np.linalg.norm(
        beyond - apply_homography(H, line + np.sign(ij.mean(axis=0) - line.mean(axis=0)).astype(int)), axis=1
    )
    margin = np.maximum(NEAR * step, NEAR_PX)
    width, height = image_size
    x, y = beyond.T
    over: dict[Side, Array] = {
        "left": margin - x,
        "right": x - (width - 1 - margin),
        "upper": margin - y,
        "lower": y - (height - 1 - margin),
    }
    hidden = np.any([o > 0 for o in over.values()], axis=0)
    if not hidden.mean() > HIDDEN:
        return []
    return [max(over, key=lambda side: float((over[side] > 0).sum() + 1e-6 * over[side].mean()))]


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
