"""Geiger et al., ICRA 2012: boards grown from 3 × 3 corners by whole lines; our implementation (docs/peers.md)."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn import __version__
from rcdn.boards.geiger import Pool, energy, grow_lines
from rcdn.boards.paper import even, start_matrix
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.peers.geiger_corners import GeigerCorners, geiger_corners
from rcdn_lab.peers.labels import labelled

LARGEST_ENERGY = -10.0
"""largest energy of an accepted board"""
SEEDS = 1000
"""Most corners, those with the best scores, that are tried as the centre of 3 × 3: this limits the time on texture."""


def geiger_boards(found: GeigerCorners) -> list[Array]:
    """Indices (rows, columns) of the corners of each board, the one of least energy first. No corner is in two boards.

    Each corner outside the boards so far is tried as a seed, in the order of decreasing score. A new board that shares
    corners with others replaces them if its energy is less than that of each of them.
    """
    boards: list[tuple[float, Array]] = []
    if len(found.xy) < 9:
        return []
    pool = Pool(found.xy, found.angles)
    inside = np.zeros(len(found.xy), int)
    for seed in range(min(SEEDS, len(found.xy))):
        if inside[seed]:
            continue
        new = _board_at(pool, seed)
        if new is None or new[0] > LARGEST_ENERGY:
            continue
        rivals = [k for k, (_, other) in enumerate(boards) if np.isin(other, new[1]).any()]
        if all(new[0] < boards[k][0] for k in rivals):
            boards = [board for k, board in enumerate(boards) if k not in rivals] + [new]
            inside[:] = 0
            inside[np.concatenate([b.ravel() for _, b in boards])] = 1
    return [index for _, index in sorted(boards, key=lambda b: (b[0], b[1].min()))]


def _board_at(pool: Pool, seed: int) -> tuple[float, Array] | None:
    """Energy and indices of the board grown from the 3 × 3 corners around `seed`; None if there are no nine suitable
    ones."""
    a, b = sorted(pool.angles[seed].tolist())
    at = start_matrix(pool, seed, a, b)
    if len(at) < 9:
        return None
    index = np.array([[at[u, v] for u in (-1, 0, 1)] for v in (-1, 0, 1)])
    if not even(pool, index):
        return None
    index = grow_lines(pool, index)
    return energy(pool.xy[index]), index


def _find(image: Array, _size: tuple[int, int]) -> list[Grid]:
    found = geiger_corners(image)
    return [labelled(image, found.xy[index]) for index in geiger_boards(found)]


def _load() -> Find:
    cv2.setNumThreads(1)
    return _find


GEIGER = Peer("geiger", "free", lambda: None, lambda: __version__, _load)
