"""The position of a board in its picture, described by the four corners of its grid, and the distance of two such
outlines."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.types import Array, Board
from rcdn.types.arrays import Real


def outline(board: Board) -> Real[Array, "4 2"]:
    """(4, 2) corners of the board's grid, in order around it, in units of the image's diagonal."""
    cols, rows = board.size
    box = board.ij.min(axis=0) + np.array([[0, 0], [cols - 1, 0], [cols - 1, rows - 1], [0, rows - 1]])
    wh = np.array(board.image_size, float)
    xy = apply_homography(homography(board.ij, board.xy), box)
    return np.asarray(np.clip(xy, -0.5 * wh, 1.5 * wh) / np.linalg.norm(wh))


def distances(outlines: Array, one: Array) -> Real[Array, " n"]:
    """(N,) root mean square distance between the corners of each outline and those of `one`.

    The least over the four cyclic orders of the corners: which corner a board's labels begin at is often arbitrary.
    """
    turns = [np.roll(one, k, axis=0) for k in range(4)]
    return np.min([np.sqrt(np.square(outlines - t).sum(axis=2).mean(axis=1)) for t in turns], axis=0)
