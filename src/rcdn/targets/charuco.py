"""Reads ChArUco boards without being told which: the layout of markers under which all squares together are most likely.

Each module of a marker has a log-likelihood ratio of white to black. A layout (dictionary, turn, size, place) says which bits all squares show; its
evidence is the likelihood of these bits against that of fair coins, log2. If bits were fair coins, the evidence of one layout would exceed T with a
probability of at most 2^−T (Markov), and any of M layouts with at most M · 2^−T.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rcdn.targets.families import Family, families
from rcdn.targets.layout import index_of, place_of
from rcdn.targets.marker import Appearance, Frame, appearance, evidence, inner_modules, modules
from rcdn.targets.reading import Reading
from rcdn.types import Array, Charuco

ACCEPT = 46.0
"""bits of evidence that make a layout certain: 10⁻⁶ (20 bits) over fewer than 2²⁶ layouts (4 turns, 10 families, 2 parities,
62 widths, 2,000 places, 4 rims)"""
MARGIN = 14.0
"""bits by which it must exceed the next layout"""
COVERED = 0.05
"""probability that a square doesn't show its marker: a hand, glare, a torn print"""
SIDES = (4, 5, 6, 7)
"""bits along a marker's side"""
FRAME = Frame()
MOST_COLUMNS = 64
ANCHORS, CANDIDATES = 12, 4
"""squares, and markers of each, that layouts are made from"""


@dataclass(frozen=True, eq=False)
class _Layout:
    bits: float
    look: Appearance
    family: Family
    columns: int
    place: tuple[int, int]
    odd: bool
    first: int
    turns: int
    last_row: bool
    highest: int


def read_charuco(squares: Array, marked: Array, inner: Array, aspect: float) -> Reading | None:
    """`squares` (R, C, S, S): grey over the dark squares around each, NaN where nothing is seen; `marked` (R, C): those that hold markers;
    `inner` (R, C): those all of whose corners were found; `aspect`: their width over their height, px. None if no layout is certain.
    """
    scored: list[_Scores] = []
    for side in SIDES:
        look = appearance(np.nanmean(squares[marked & inner], axis=0), side, FRAME, aspect)
        if look is not None:
            ratios = np.zeros((*marked.shape, side + 2, side + 2))
            ratios[marked] = evidence(
                modules(squares[marked], look, side, FRAME, _open_sides(marked)[marked]), FRAME.border
            )
            scored += [_Scores.of(ratios, marked, look, f, turns) for f in families(side) for turns in range(4)]
    return _best(sorted((s for s in scored if s.hope > ACCEPT), key=lambda s: -s.hope), inner)


def _open_sides(marked: Array) -> Array:
    """(R, C, 4): whether a square is the last one on the left, right, upper, lower side."""
    rows, columns = np.indices(marked.shape)
    last = marked.shape[0] - 1, marked.shape[1] - 1
    return np.stack([columns == 0, columns == last[1], rows == 0, rows == last[0]], axis=-1)


def _best(scored: list[_Scores], inner: Array) -> Reading | None:
    """The most likely layout, if it is certain: one whose markers count from 0, unless that of a whole board that begins with another is likelier."""
    usual, whole = (_likeliest(scored, inner, any_first) for any_first in (False, True))
    from_0 = bool(usual) and (not whole or usual[0].bits >= whole[0].bits)
    layouts = usual if from_0 else sorted(whole + usual[:1], key=lambda x: -x.bits)
    if not layouts or layouts[0].bits < ACCEPT:
        return None
    margin = layouts[0].bits - (layouts[1].bits if len(layouts) > 1 else 0.0)
    return _reading(layouts[0], inner, margin) if margin > MARGIN else None


def _likeliest(scored: list[_Scores], inner: Array, any_first: bool) -> list[_Layout]:
    layouts: list[_Layout] = []
    for scores in scored:
        if layouts and scores.hope < layouts[0].bits - MARGIN:
            break  # nothing that is left comes near the best
        found = filter(_possible(inner), scores.layouts(any_first))
        layouts = sorted([*layouts, *found], key=lambda x: -x.bits)
    return layouts


def _rows(layout: _Layout, inner: Array) -> int | None:
    """How many rows the board has; None if there may be more, unseen."""
    whole = layout.last_row and inner[1:-1, 1:-1].all()
    return layout.place[1] + inner.shape[layout.turns % 2] if whole else None


def _possible(inner: Array) -> Callable[[_Layout], bool]:
    """Whether a layout is one that is printed: a white first square goes with an even number of rows."""
    return lambda layout: layout.odd or (_rows(layout, inner) or 0) % 2 == 0


def _reading(top: _Layout, inner: Array, margin: float) -> Reading:
    rows = _rows(top, inner)
    target = Charuco(
        top.columns,
        rows,
        top.family.smallest(top.highest),
        round(top.look.ratio, 2),
        top.first,
        legacy=not top.odd,
        inverted=top.look.white < 0,
    )
    return Reading(target, top.turns, top.place, top.bits, margin)


@dataclass(frozen=True, eq=False)
class _Scores:
    """Evidence `gain` (K, N), bits, of N markers in K squares at `row`, `column` (K,) of a picture's (height, width) squares, turned."""

    gain: Array
    row: Array
    column: Array
    shape: tuple[int, int]
    look: Appearance
    family: Family
    turns: int

    @classmethod
    def of(cls, ratios: Array, marked: Array, look: Appearance, family: Family, turns: int) -> _Scores:
        turned = np.rot90(np.rot90(ratios, turns, (0, 1)), turns, (2, 3))
        row, column = np.nonzero(np.rot90(marked, turns))
        gain = gains(turned[row, column], family.bits, FRAME.border)
        height, width = marked.shape if turns % 2 == 0 else marked.shape[::-1]
        return cls(gain, row, column, (height, width), look, family, turns)

    @property
    def hope(self) -> float:
        """More evidence than this no layout has."""
        return float(np.maximum(self.gain.max(axis=1), 0).sum()) if self.gain.size else 0.0

    def layouts(self, any_first: bool) -> Iterator[_Layout]:
        """The most likely layouts: with the markers counted from 0, or (`any_first`) from any number but then just as large as the squares seen."""
        found = self._whole_boards() if any_first else self._parts_of_boards()
        found = np.unique(found, axis=0)
        if not len(found):
            return
        u, v, columns, odd, first = (a[:, None] for a in found.T)
        column, row = u + self.column, v + self.row
        on_board = (column >= 0) & (row >= 0) & (column < columns)
        marker = first + index_of(column, row, columns, odd.astype(bool))
        last = np.broadcast_to(self.row == self.shape[0] - 1, marker.shape)
        exists = on_board & (marker >= 0) & (marker < len(self.family))
        gain = np.where(exists, self.gain[np.arange(len(self.row)), np.clip(marker, 0, len(self.family) - 1)], 0.0)
        body, foot = (gain * ~last).sum(axis=1), (gain * last).sum(axis=1)
        bits = np.where((on_board & ~exists & ~last).any(axis=1), -np.inf, body + np.maximum(foot, 0))
        for k in np.argsort(-bits)[:3]:
            used = exists[k] & (~last[k] | (foot[k] > 0))
            if np.isfinite(bits[k]) and used.any():
                place = (int(u[k, 0]), int(v[k, 0]))
                yield _Layout(
                    float(bits[k]), self.look, self.family, int(columns[k, 0]), place, bool(odd[k, 0]), int(first[k, 0]), self.turns,
                    bool(foot[k] > 0), int(marker[k][used].max()),
                )  # fmt: skip

    def _anchors(self) -> tuple[Array, Array]:
        """Squares (A,) that are surest of their marker, and the likeliest markers of each, together (A · CANDIDATES,)."""
        surest = np.argsort(-self.gain.max(axis=1))[:ANCHORS]
        markers = np.argsort(-self.gain[surest], axis=1)[:, :CANDIDATES]
        return np.repeat(surest, markers.shape[1]), markers.ravel()

    def _parts_of_boards(self) -> Array:
        """Candidate layouts (M, 5): column and row of the first square, columns, parity, first marker."""
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

    def _whole_boards(self) -> Array:
        square, marker = self._anchors()
        k, odd = (a.ravel() for a in np.meshgrid(np.arange(len(square)), [0, 1], indexing="ij"))
        columns = np.full_like(k, self.shape[1])
        first = marker[k] - index_of(self.column[square[k]], self.row[square[k]], columns, odd.astype(bool))
        zero = np.zeros_like(k)
        return np.stack([zero, zero, columns, odd, first], axis=1)[first > 0]


def gains(ratios: Array, bits: Array, border: int) -> Array:
    """Evidence (K, N), bits, of each of N markers `bits` (N, n, n) in each of K squares whose modules have log-likelihood `ratios` (K, m, m)."""
    inside = inner_modules(ratios.shape[-1], border)
    own, frame = ratios[:, inside], ratios[:, ~inside]
    black = _gain(-own).sum(axis=1) + np.minimum(_gain(-frame).sum(axis=1), 0)  # the frame is black, or it is no marker
    shown = black[:, None] + (own / np.log(2)) @ bits.reshape(len(bits), -1).T.astype(float)
    return np.asarray(np.log2(COVERED + (1 - COVERED) * np.exp2(np.minimum(shown, 500))))


def _gain(ratio: Array) -> Array:
    """Bits by which a fair coin is less likely than the side that the log-likelihood `ratio` is of."""
    return 1 - np.logaddexp(0, -ratio) / np.log(2)
