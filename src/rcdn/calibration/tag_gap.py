"""Estimate of the gap between the tags of an AprilGrid from all of its pictures; the tags' codes do not contain it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.types import AprilGrid, Array, Board
from rcdn.types.arrays import Real

NEAR, CERTAIN = 0.002, 4.0
"""deviation (in sides of a tag; in standard errors) within which the gap with which the boards were read is kept"""


def gap_of(boards: Sequence[Board]) -> float:
    """Gap between tags divided by their side, of the AprilGrid that all `boards` show: the value with which they were
    read or, if the corners contradict it, the value estimated from the corners.

    Four collinear corners, the sides of two neighbouring tags, have a cross-ratio that is invariant under projection
    and hardly changed by distortion; it determines the gap.
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
    """Estimates of the gap from each four collinear corners of two tags, NaN where they give none."""
    grid = np.full((*(2 * (board.ij.max(axis=0) // 2 + 1)), 2), np.nan)
    grid[board.ij[:, 0], board.ij[:, 1]] = board.xy
    return np.concatenate([_of_lines(lines) for lines in (grid, grid.swapaxes(0, 1))])


def _of_lines(lines: Real[Array, "c r 2"]) -> Array:
    """Estimates of the gap from `lines` (C, R, 2) px: corners along the first axis."""
    a, b, c, d = (lines[k : len(lines) - 3 + k : 2] for k in range(4))
    ab, bc, cd, ac, bd, ad = (
        np.linalg.norm(q - p, axis=-1) for p, q in ((a, b), (b, c), (c, d), (a, c), (b, d), (a, d))
    )
    # with sides of 1 and a gap g the ratio ab·cd / (ac·bd) is 1 / (1 + g)²
    with np.errstate(invalid="ignore", divide="ignore"):
        gaps = np.sqrt(ac * bd / (ab * cd)) - 1
        straight = ad > 0.98 * (ab + bc + cd)
    return np.asarray(np.where(straight, gaps, np.nan)).ravel()
