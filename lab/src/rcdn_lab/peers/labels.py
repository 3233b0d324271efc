"""Labels by our ordering contract for a lattice of corners, and the distances between its corners: shared by the
detectors implemented here."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.geometry.order import ordered
from rcdn.types import Array
from rcdn_lab.peers.base import Grid


def labelled(grey: Array, xy: Array) -> Grid:
    """The corners `xy` (rows, columns, 2) px of a board in `grey` (H, W) as a grid, row by row; NaN: a corner that is
    missing.

    A mirrored lattice is reflected. The grey levels between the corners determine the colours of the squares; (0, 0) is
    then as defined in docs/conventions.md, for the smallest rectangle that contains all corners.
    """
    known = np.asarray(np.isfinite(xy).all(axis=2))
    down, along = (np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0)))
    xy = xy[down[0] : down[-1] + 1, along[0] : along[-1] + 1]
    if _mirrored(xy):
        xy = xy[::-1]
    known = np.asarray(np.isfinite(xy).all(axis=2))
    ij, flat = np.argwhere(known)[:, ::-1], xy[known]
    ij = ordered(ij, flat, _first_square(grey, xy))
    order = np.lexsort((ij[:, 0], ij[:, 1]))
    return Grid(flat[order], ij[order])


def _mirrored(xy: Array) -> bool:
    """Whether most of the lattice's cells, by area, are seen from behind."""
    right, below = np.diff(xy, axis=1)[:-1], np.diff(xy, axis=0)[:, :-1]
    return bool(np.nansum(right[..., 0] * below[..., 1] - right[..., 1] * below[..., 0]) < 0)


def _first_square(grey: Array, xy: Array) -> int:
    """+1 if the squares of the colour of the one between (0, 0) and (1, 1) are bright, −1 if they are dark."""
    middle = ((xy[:-1, :-1] + xy[1:, 1:] + xy[:-1, 1:] + xy[1:, :-1]) / 4).astype(np.float32)
    known = np.isfinite(middle).all(axis=2)
    x, y = (np.ascontiguousarray(middle[known][:, None, axis]) for axis in (0, 1))
    level = cv2.remap(grey.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()
    odd = np.indices(known.shape).sum(axis=0)[known] % 2 == 1
    mean = [level[part].mean() if part.any() else grey.mean() for part in (~odd, odd)]
    return 1 if mean[0] > mean[1] else -1


def pitch(xy: Array) -> Array:
    """Distance (rows, columns), px, of each corner `xy` (rows, columns, 2) from the nearest of its neighbours in the
    lattice; infinite without one. NaN: a corner that is missing."""
    out = np.full(xy.shape[:2], np.inf)
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(xy, axis=axis), axis=-1)
        first, last = (slice(None, -1), slice(1, None)) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
        out[first], out[last] = np.fmin(out[first], step), np.fmin(out[last], step)
    return out
