"""Hypotheses of ChArUco layouts (dictionary, columns, parity, first marker, place), and their evidence in all
squares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rcdn.targets.families import Family
from rcdn.targets.gains import MOST_COLUMNS
from rcdn.targets.layout import index_of, odd_markers, place_of
from rcdn.targets.marker import Appearance
from rcdn.types import Array, Charuco
from rcdn.types.arrays import Bool, Real

CERTAIN = 5.0
"""bits of evidence, in addition to log2 of the number of markers, with which a square is certain of its marker"""
AGAINST = 0.125
"""largest share of squares certain of other markers than their layout's, relative to those certain of its markers"""
HOPEFUL = 100
"""largest number of layouts of one family and orientation that are evaluated on all squares"""
ANCHORS, CANDIDATES = 12, 4
"""number of squares, and of candidate markers of each, that generate hypotheses of layouts"""


@dataclass(frozen=True, eq=False)
class Layout:
    """A layout with `bits` of evidence: markers of a `family`, seen with an `appearance`, on a board of so many
    `columns` whose square `place` (column, row) is the first of the rotated picture.

    `odd`: whether squares of odd column + row have the markers, `first` and `highest` the least and the greatest number
    of one; `turns`: counter-clockwise quarter turns of the picture; `last_row`: whether the last row of squares is on
    the board; `contradicted`: see there.
    """

    bits: float
    appearance: Appearance
    family: Family
    columns: int
    place: tuple[int, int]
    odd: bool
    first: int
    turns: int
    last_row: bool
    highest: int
    contradicted: bool


@dataclass(frozen=True, eq=False)
class Scores:
    """Evidence `gain` (K, N), bits, for N markers in K squares at `row`, `column` (K,) of the `shape` (height, width)
    squares of the rotated picture."""

    gain: Array
    row: Array
    column: Array
    shape: tuple[int, int]
    appearance: Appearance
    family: Family
    turns: int

    @cached_property
    def most(self) -> Real[Array, " k"]:
        """Evidence (K,) for the likeliest marker of each square."""
        return np.asarray(self.gain.max(axis=1))

    @property
    def hope(self) -> float:
        """Upper bound of the evidence for any layout."""
        return float(np.maximum(self.most, 0).sum()) if self.gain.size else 0.0

    def layouts(self, any_first: bool) -> Iterator[Layout]:
        """The most likely layouts: with markers counted from 0, or (`any_first`) from any number, but then exactly as
        large as the squares seen."""
        yield from self.scored(self._hopeful(_unique(self._whole_boards() if any_first else self._parts_of_boards())))

    def _hopeful(self, found: Array) -> Real[Array, "m 5"]:
        """The layouts (M, 5) with the most evidence in the most certain squares, at most `HOPEFUL` of them."""
        if len(found) <= HOPEFUL:
            return found
        some = np.argsort(-self.most)[:ANCHORS]
        marker, exists, _ = self._markers_of(found, some, None)
        bits = np.where(exists, self.gain[some, np.clip(marker, 0, len(self.family) - 1)], 0.0).sum(axis=1)
        return found[np.argsort(-bits, kind="stable")[:HOPEFUL]]

    def _markers_of(self, found: Real[Array, "m 5"], some: Array, rows: int | None) -> tuple[Array, Array, Array]:
        """The marker (M, S) in each of `some` (S,) squares according to the layouts `found` (M, 5), whether such a
        marker exists, and whether the square is on the board."""
        u, v, columns, odd, first = (a[:, None] for a in found.T)
        column, row = u + self.column[some], v + self.row[some]
        on_board = (column >= 0) & (row >= 0) & (column < columns) & (row < (rows or np.inf))
        marker = first + index_of(column, row, columns, odd.astype(bool))
        return marker, on_board & (marker >= 0) & (marker < len(self.family)), on_board

    def scored(self, found: Real[Array, "m 5"], rows: int | None = None) -> Iterator[Layout]:
        """The three likeliest of the layouts `found` (M, 5), see `_parts_of_boards`; `rows`: number of rows of the
        board, if known."""
        if not len(found):
            return
        marker, exists, on_board = self._markers_of(found, np.arange(len(self.row)), rows)
        last = np.broadcast_to(self.row == self.shape[0] - 1, marker.shape)
        gain = np.where(exists, self.gain[np.arange(len(self.row)), np.clip(marker, 0, len(self.family) - 1)], 0.0)
        body, foot = (gain * ~last).sum(axis=1), (gain * last).sum(axis=1)
        bits = np.where((on_board & ~exists & ~last).any(axis=1), -np.inf, body + np.maximum(foot, 0))
        for k in np.argsort(-bits)[:3]:
            used = exists[k] & (~last[k] | (foot[k] > 0))
            if np.isfinite(bits[k]) and used.any() and self._agree_with(gain[k]):
                u, v, columns, odd, first = found[k].tolist()
                yield Layout(
                    float(bits[k]), self.appearance, self.family, columns, (u, v), bool(odd), first, self.turns,
                    bool(foot[k] > 0), int(marker[k][used].max()),
                    contradicted(self.most[exists[k]], gain[k][exists[k]], len(self.family)),
                )  # fmt: skip

    def _agree_with(self, gain: Real[Array, " k"]) -> bool:
        """Whether most of the squares that are certain of their marker by themselves agree with a layout, whose
        evidence in each is `gain` (K,).

        Without this test a few markers that are consecutive by chance would outweigh the contradiction of all others.
        """
        certain = _certain(self.most, len(self.family))
        return bool((certain & (gain <= 0)).sum() <= (certain & (gain > 0)).sum())

    def _anchors(self) -> tuple[Array, Array]:
        """The squares that are most certain of their marker, and the likeliest markers of each, as pairs (ANCHORS ·
        CANDIDATES,)."""
        surest = np.argsort(-self.most)[:ANCHORS]
        least = min(CANDIDATES, self.gain.shape[1]) - 1
        markers = np.argpartition(-self.gain[surest], least, axis=1)[:, : least + 1]
        return np.repeat(surest, markers.shape[1]), markers.ravel()

    def _parts_of_boards(self) -> Real[Array, "m 5"]:
        """Hypotheses of layouts (M, 5): column and row of the first square, columns, parity, first marker."""
        square, marker = self._anchors()
        k, columns, odd = (
            a.ravel()
            for a in np.meshgrid(np.arange(len(square)), np.arange(2, MOST_COLUMNS + 1), [0, 1], indexing="ij")
        )
        column, row = place_of(marker[k], columns, odd.astype(bool))
        u, v = column - self.column[square[k]], row - self.row[square[k]]
        # the outermost squares that were sampled may lie beyond the board
        fits = (u >= -1) & (v >= -1) & (u + self.shape[1] - 1 <= columns)
        return np.stack([u, v, columns, odd, np.zeros_like(u)], axis=1)[fits]

    def places_on(self, given: Charuco) -> Real[Array, "m 5"]:
        """All layouts (M, 5) on the `given` board that have markers in the squares where some are seen."""
        height, width = self.shape
        odd = odd_markers(given)
        most = given.rows or int(place_of(np.array(len(self.family)), np.array(given.columns), np.array(odd))[1]) + 1
        # the outermost squares that were sampled may lie beyond the board
        u, v = np.meshgrid(np.arange(-1, given.columns - width + 2), np.arange(-1, most - height + 2))
        u, v = (a[(u + v + self.column[0] + self.row[0]) % 2 == odd] for a in (u, v))
        known = (np.full(u.size, n) for n in (given.columns, odd, given.first_id))
        return np.stack([u, v, *known], axis=1)

    def _whole_boards(self) -> Real[Array, "m 5"]:
        """Hypotheses of layouts (M, 5) of boards that are exactly the squares seen; the squares with markers determine
        the parity."""
        square, marker = self._anchors()
        column, row = self.column[square], self.row[square]
        columns, odd, zero = np.full_like(square, self.shape[1]), (column + row) % 2, np.zeros_like(square)
        first = marker - index_of(column, row, columns, odd.astype(bool))
        return np.stack([zero, zero, columns, odd, first], axis=1)[first > 0]


def contradicted(most: Real[Array, " k"], gain: Real[Array, " k"], markers: int) -> bool:
    """Whether too many squares are certain of another marker than a layout has in them: it is then one of parts that
    don't belong together, such as those of a torn frame, and the numbers of some or all corners would be wrong.

    `most`, `gain` (K,): evidence of the squares for the likeliest of so many `markers`, and for the layout's. Squares
    that can't be read, behind a cover or under glare, don't contradict.
    """
    certain = _certain(most, markers)
    return bool((certain & (gain <= 0)).sum() > AGAINST * (certain & (gain > 0)).sum())


def _certain(most: Real[Array, " k"], markers: int) -> Bool[Array, " k"]:
    return np.asarray(most > CERTAIN + np.log2(markers))


def _unique(layouts: Array) -> Real[Array, "m 5"]:
    """The distinct `layouts` (M, 5)."""
    if not len(layouts):
        return layouts
    low = layouts.min(axis=0)
    key = np.ravel_multi_index(tuple((layouts - low).T), tuple((np.ptp(layouts, axis=0) + 1).tolist()))
    return np.asarray(layouts[np.unique(key, return_index=True)[1]])
