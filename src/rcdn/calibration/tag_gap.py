"""The gap between the tags of an AprilGrid, from all of its pictures: their codes don't say it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.types import AprilGrid, Array, Board
from rcdn.types.arrays import Real

NEAR, CERTAIN = 0.002, 4.0
"""sides of a tag, and standard deviations, within which the gap that the boards were read with stands"""


def gap_of(boards: Sequence[Board]) -> float:
    """Distance of tags over their side, of the AprilGrid that all `boards` show: the one that they were read with, or, where the corners
    disagree with it, theirs.

    Four corners in a line, the sides of two neighbouring tags, have a cross-ratio that no projection changes and a lens hardly: it tells the gap.
    """
    stated = float(np.median([b.target.gap for b in boards if isinstance(b.target, AprilGrid)]))
    each = np.concatenate([_gaps(b) for b in boards])
    each = each[np.isfinite(each)]
    if len(each) < 8:
        return stated
    middle = float(np.median(each))
    spread = 1.4826 * float(np.median(np.abs(each - middle)))
    good = each[np.abs(each - middle) <= 3 * spread + 1e-9]
    found, error = float(good.mean()), float(good.std() / np.sqrt(len(good)))
    return stated if abs(found - stated) <= max(NEAR, CERTAIN * error) else round(found, 4)


def _gaps(board: Board) -> Array:
    """The gap by every four corners of two tags in a line, NaN where they tell none."""
    grid = np.full((*(2 * (board.ij.max(axis=0) // 2 + 1)), 2), np.nan)
    grid[board.ij[:, 0], board.ij[:, 1]] = board.xy
    return np.concatenate([_of_lines(lines) for lines in (grid, grid.swapaxes(0, 1))])


def _of_lines(lines: Real[Array, "c r 2"]) -> Array:
    """`lines` (C, R, 2) px: corners along the first axis."""
    a, b, c, d = (lines[k : len(lines) - 3 + k : 2] for k in range(4))
    ab, bc, cd, ac, bd, ad = (
        np.linalg.norm(q - p, axis=-1) for p, q in ((a, b), (b, c), (c, d), (a, c), (b, d), (a, d))
    )
    # with sides of 1 and a gap g the ratio ab·cd / (ac·bd) is 1 / (1 + g)²
    with np.errstate(invalid="ignore", divide="ignore"):
        gaps = np.sqrt(ac * bd / (ab * cd)) - 1
        straight = ad > 0.98 * (ab + bc + cd)
    return np.asarray(np.where(straight, gaps, np.nan)).ravel()
