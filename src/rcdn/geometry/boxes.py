"""Spatial index of points and boxes in square cells, so that a query for a box need not scan all of them."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Real

EACH = 16
"""points per cell, approximately"""
FEW = 8
"""queries that are answered by scanning all points, before the index is built"""
AWAY = -1e5
"""px; points below this, placed far outside any picture to discard them, are in no box"""


class _Table(NamedTuple):
    """Points sorted into `cells` (2,) cells of `size` px, starting at `low` (2,): `order` holds their rows, those of
    cell k from `first[k]` to `first[k + 1]`."""

    low: Array
    size: float
    cells: Array
    order: Array
    first: Array

    def cell(self, at: Real[Array, "... 2"]) -> Array:
        """Column and row of the cell of each position in `at` (..., 2); the nearest cell for positions outside."""
        return np.clip((at - self.low) // self.size, 0, self.cells - 1).astype(np.int64).T


def _sorted(points: Array) -> _Table:
    rows = np.flatnonzero((points > AWAY).all(axis=1))
    at = points[rows]
    low = at.min(axis=0) if len(at) else np.zeros(2)
    span = at.max(axis=0) - low if len(at) else np.zeros(2)
    each = EACH / max(len(at), 1)
    size = max(float(np.sqrt(span.prod() * each)), float(span.max()) * each, 1e-3)
    table = _Table(low, size, (span / size).astype(np.int64) + 1, rows, rows)
    column, row = table.cell(at)
    cell = row * table.cells[0] + column
    first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(table.cells.prod())))])
    return table._replace(order=rows[np.argsort(cell, kind="stable")], first=first)


class PointCells:
    """`points` (N, 2) with an index of square cells of about `EACH` points, built after `FEW` queries: for fewer
    queries a scan of all points is faster."""

    def __init__(self, points: Array) -> None:
        self.points = points
        self._queries = 0

    @cached_property
    def _table(self) -> _Table:
        return _sorted(self.points)

    def share(self, low: Array, high: Array) -> float:
        """Share of all cells that a box intersects."""
        table = self._table
        (left, top), (right, bottom) = table.cell(low).tolist(), table.cell(high).tolist()
        return (right - left + 1) * (bottom - top + 1) / float(table.cells.prod())

    def inside(self, low: Real[Array, " 2"], high: Real[Array, " 2"]) -> Array:
        """Rows, in ascending order, of the points in the closed box from `low` (2,) to `high` (2,)."""
        if not (high >= low).all():
            return np.zeros(0, np.int64)
        self._queries += 1
        if self._queries <= FEW:
            inside = (self.points >= low) & (self.points <= high) & (self.points > AWAY)
            return np.flatnonzero(inside[:, 0] & inside[:, 1])
        table = self._table
        (left, top), (right, bottom) = table.cell(low).tolist(), table.cell(high).tolist()
        columns = int(table.cells[0])
        lines = range(top * columns, (bottom + 1) * columns, columns)
        found = np.concatenate([table.order[table.first[k + left] : table.first[k + right + 1]] for k in lines])
        at = self.points[found]
        return np.sort(found[((at >= low) & (at <= high)).all(axis=1)])


class BoxCells:
    """Index of boxes `low`, `high` (N, 2): each is listed in all cells that it intersects. A cell has about the area of
    an average box."""

    def __init__(self, low: Array, high: Array) -> None:
        self.low, self.high = low, high
        span = high - low
        extent = high.max(axis=0) - low.min(axis=0) if len(low) else np.ones(2)
        side = float(np.sqrt(span.prod(axis=1).mean())) if len(low) else 1.0
        self._size = max(
            side, float(span.mean(axis=0).max(initial=0)), float(extent.max()) / (4 * max(len(low), 1)), 1e-3
        )
        self._held: dict[tuple[int, int], list[int]] = {}
        for box in range(len(low)):
            for cell in self._cells(low[box], high[box]):
                self._held.setdefault(cell, []).append(box)

    def _cells(self, low: Array, high: Array) -> list[tuple[int, int]]:
        (left, top), (right, bottom) = ((a // self._size).astype(int).tolist() for a in (low, high))
        return [(i, j) for i in range(left, right + 1) for j in range(top, bottom + 1)]

    def touched(self, low: Real[Array, " 2"], high: Real[Array, " 2"]) -> list[int]:
        """Numbers, in ascending order, of the boxes that intersect the closed box from `low` (2,) to `high` (2,)."""
        near = {box for cell in self._cells(low, high) for box in self._held.get(cell, ())}
        some = np.array(sorted(near), np.int64)
        if not len(some):
            return []
        return some[((self.low[some] <= high) & (self.high[some] >= low)).all(axis=1)].tolist()
