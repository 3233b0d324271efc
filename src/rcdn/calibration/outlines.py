"""Where a board lies in its picture, by the four corners of its grid: how far two boards are apart there."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array, Board
from rcdn.types.arrays import Real


def outline(board: Board) -> Real[Array, "4 2"]:
    """(4, 2) corners of the board's grid, in order around it, in diagonals of the image."""
    cols, rows = board.size
    box = board.ij.min(axis=0) + np.array([[0, 0], [cols - 1, 0], [cols - 1, rows - 1], [0, rows - 1]])
    wh = np.array(board.image_size, float)
    xy = apply_homography(homography(board.ij, board.xy), box)
    return np.asarray(np.clip(xy, -0.5 * wh, 1.5 * wh) / np.linalg.norm(wh))


def distances(outlines: Array, one: Array) -> Real[Array, " n"]:
    """(N,) root mean square distance of the corners of each outline from those of `one`.

    The least over the four turns: where a board's labels begin is often arbitrary.
    """
    turns = [np.roll(one, k, axis=0) for k in range(4)]
    return np.min([np.sqrt(np.square(outlines - t).sum(axis=2).mean(axis=1)) for t in turns], axis=0)
