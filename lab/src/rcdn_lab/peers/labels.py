"""Labels by our ordering contract for a lattice of corners: shared by the detectors implemented here."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.boards.order import ordered
from rcdn.types import Array
from rcdn_lab.peers.base import Grid, lattice


def labelled(grey: Array, xy: Array) -> Grid:
    """The corners `xy` (rows, columns, 2) px of a whole board in `grey` (H, W) as a grid, row by row.

    A mirrored lattice is reflected. The grey levels between the corners determine the colours of the squares; (0, 0) is
    then as defined in docs/conventions.md.
    """
    along, down = xy[:, -1] - xy[:, 0], xy[-1] - xy[0]
    if np.linalg.det(np.stack([along.sum(axis=0), down.sum(axis=0)])) < 0:
        xy = xy[::-1]
    rows, cols = xy.shape[:2]
    flat = xy.reshape(-1, 2)
    ij = ordered(lattice((cols, rows)), flat, _first_square(grey, xy))
    order = np.lexsort((ij[:, 0], ij[:, 1]))
    return Grid(flat[order], ij[order])


def _first_square(grey: Array, xy: Array) -> int:
    """+1 if the squares of the colour of the one between (0, 0) and (1, 1) are bright, −1 if they are dark."""
    middle = ((xy[:-1, :-1] + xy[1:, 1:] + xy[:-1, 1:] + xy[1:, :-1]) / 4).astype(np.float32)
    x, y = np.ascontiguousarray(middle[..., 0]), np.ascontiguousarray(middle[..., 1])
    level = cv2.remap(grey.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    sign = (-1.0) ** np.indices(level.shape).sum(axis=0)
    odd = sign < 0
    other = level[odd].mean() if odd.any() else grey.mean()
    return 1 if level[~odd].mean() > other else -1
