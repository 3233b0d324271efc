"""Rows of arrays of points: lists of them as one, and where the very same point is in another."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array


def joint(parts: list[Array], empty: int | tuple[int, ...]) -> Array:
    """All parts in one array; zeros of the shape `empty` if there is none."""
    return np.concatenate(parts) if parts else np.zeros(empty)


def rows_among(xy: Array, among: Array) -> Array:
    """Row (N,) of each of `xy` (N, 2) in `among` (M, 2), the very same numbers; −1 if it isn't there."""
    wanted, known = (np.ascontiguousarray(a, np.float64).view(np.complex128)[:, 0] for a in (xy, among))
    if not len(known):
        return np.full(len(wanted), -1)
    order = np.argsort(known, kind="stable")
    row = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(known) - 1)]
    return np.where(known[row] == wanted, row, -1)
