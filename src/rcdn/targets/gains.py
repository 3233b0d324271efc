"""How much the squares of a board speak for each marker of a family, and the most that they can say for markers that follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rcdn.native import bind, constants
from rcdn.targets.families import Family
from rcdn.targets.marker import inner_modules
from rcdn.types import Array

COVERED, COVERED_RIM, BLANK = 0.05, 0.3, 0.02
"""probability that a square doesn't show its marker (a hand, glare, a torn print); that one doesn't some of whose corners weren't found; that such a
one shows paper instead"""
PAPER = 0.6
"""share of a marker's black border that is white on paper without it"""
UNLIKE = -30.0
"""bits of evidence for a marker under which a square is taken to hide it, which is right to a ten-millionth of a bit"""
MOST_COLUMNS = 64
SLACK = 0.01
"""bits a square by which single precision may miss evidence"""


class _Turned(NamedTuple):
    """Squares of a board in pictures that are turned by quarters, as the kernel reads them."""

    own: Array
    black: Array
    covered: Array
    free: Array
    role: Array


_ROLE = constants("gains")
_BLOCK = _ROLE["BLOCK"]
_most = bind("rcdn_most_evidence", _Turned)


@dataclass(frozen=True, eq=False)
class TurnedSquares:
    """Log-likelihood `ratios` (K, m, m) of white to black modules in the K squares with markers of a board of `shape` (rows, columns) squares, turned by
    `turns` quarters; their `row` and `column` (K,) there, row by row; `covered` (K,), probability that a square doesn't show its marker."""

    ratios: Array
    row: Array
    column: Array
    covered: Array
    shape: tuple[int, int]
    turns: int

    @classmethod
    def of(cls, ratios: Array, marked: Array, inner: Array, border: int, turns: int) -> TurnedSquares:
        """`ratios` (R, C, m, m); `marked` (R, C): those with markers; `inner` (R, C): those all of whose corners were found."""
        turned = np.rot90(np.rot90(ratios, turns, (0, 1)), turns, (2, 3))
        marked = np.rot90(marked, turns)
        row, column = np.nonzero(marked)
        shown = turned[row, column]
        paper = (shown[:, ~inner_modules(shown.shape[-1], border)] > 1).mean(axis=1) > PAPER
        covered = np.where(np.rot90(inner, turns)[row, column], COVERED, np.where(paper, BLANK, COVERED_RIM))
        return cls(shown, row, column, covered, (marked.shape[0], marked.shape[1]), turns)

    def gains(self, family: Family, border: int) -> Array:
        """Evidence (K, N), bits, of each marker in each square."""
        return gains(self.ratios, family.bits, border, self.covered[:, None])


def most_evidence(turned: Sequence[TurnedSquares], families: Sequence[Family], border: int, least: float) -> Array:
    """(families, turns): evidence, bits, that no layout of a board has more of, whatever its first marker, its size and its place.

    `turned`: the squares of one board, turned by quarters, every second one a marked one. The numbers of markers rise by one from square to square along a
    row, so that a row says no more than it does for the likeliest number of its first square; where these sums come to `least`, all rows are looked at
    together, for every number of columns. The outermost squares may lie beyond the board; those of the last row may be none.
    """
    out = np.zeros((len(families), len(turned)))
    if not len(turned[0].row):
        return out
    squares, slack = _squares(turned, border), SLACK * len(turned[0].row)
    width = np.array([t.shape[1] for t in turned], np.int32)
    narrowest, widest = np.maximum(width - 2, 2), np.maximum(width, np.int32(MOST_COLUMNS))
    for family, most in zip(families, out, strict=True):
        if len(family):
            _most(squares, _bits(family), len(family), narrowest, widest, least - slack, most)
    return out + slack


def _squares(turned: Sequence[TurnedSquares], border: int) -> _Turned:
    inside = inner_modules(turned[0].ratios.shape[-1], border)
    single = lambda rows: np.ascontiguousarray(np.stack(rows), np.float32)  # noqa: E731
    covered = np.stack([t.covered for t in turned])
    own, black = zip(*(_parts(t.ratios, inside) for t in turned), strict=True)
    role = np.stack([_roles(t) for t in turned])
    return _Turned(single(own), single(black), *(single(np.log2(p)) for p in (covered, 1 - covered)), role)


def _roles(turned: TurnedSquares) -> Array:
    """What the kernel must know of each square (K,)."""
    row, column, (height, width) = turned.row, turned.column, turned.shape
    first = np.diff(row, prepend=-1) > 0
    beside, last = (column == 0) | (column == width - 1), row == height - 1
    return np.asarray(
        first * _ROLE["FIRST"] + beside * _ROLE["BESIDE"] + (last | (row == 0)) * _ROLE["LOOSE"] + last * _ROLE["LAST"],
        np.int32,
    )


@lru_cache
def _bits(family: Family) -> Array:
    """Bits of the markers, (blocks, bits, markers of a block) float32."""
    flat = family.bits.reshape(len(family), -1)
    flat = np.pad(flat, ((0, -len(flat) % _BLOCK), (0, 0)))
    return np.ascontiguousarray(flat.reshape(-1, _BLOCK, flat.shape[1]).swapaxes(1, 2), np.float32)


def gains(ratios: Array, bits: Array, border: int, covered: Array | float = COVERED) -> Array:
    """Evidence (K, N), bits, of each of N markers `bits` (N, n, n) in each of K squares whose modules have log-likelihood `ratios` (K, m, m).

    `covered` (K, 1), or one for all: probability that a square doesn't show its marker.
    """
    own, black = _parts(ratios, inner_modules(ratios.shape[-1], border))
    shown = black[:, None] + own @ bits.reshape(len(bits), -1).T.astype(float)
    known = shown > UNLIKE  # most squares and markers are nothing to each other
    covered = np.broadcast_to(covered, shown.shape)
    out = np.log2(covered)
    out[known] = np.log2(covered[known] + (1 - covered[known]) * np.exp2(np.minimum(shown[known], 500)))
    return out


def _parts(ratios: Array, inside: Array) -> tuple[Array, Array]:
    """Of squares (K, m, m): what each bit tells if it is white rather than black, (K, n²) bits; what they tell with all bits black, (K,)."""
    own, frame = ratios[:, inside], ratios[:, ~inside]
    black = _gain(-own).sum(axis=1) + np.minimum(_gain(-frame).sum(axis=1), 0)  # the frame is black, or it is no marker
    return own / np.log(2), black


def framed(ratios: Array, border: int) -> float:
    """Evidence, bits, for black borders of markers whose modules have log-likelihood `ratios` (K, m, m), hidden ones among them."""
    frame = ratios[:, ~inner_modules(ratios.shape[-1], border)]
    black = np.minimum(_gain(-frame).sum(axis=1), 500)
    return float(np.log2(COVERED_RIM + (1 - COVERED_RIM) * np.exp2(black)).sum())


def _gain(ratio: Array) -> Array:
    """Bits by which a fair coin is less likely than the side that the log-likelihood `ratio` is of."""
    return 1 - np.logaddexp(0, -ratio) / np.log(2)
