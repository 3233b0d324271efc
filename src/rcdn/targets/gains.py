"""Evidence of a board's squares for each marker of a family, and an upper bound of the evidence for consecutive
markers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from rcdn.native import bind, constants
from rcdn.targets.families import Family
from rcdn.targets.marker import inner_modules
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real, Shaped

COVERED, COVERED_RIM, BLANK = 0.05, 0.3, 0.02
"""probability that a square doesn't show its marker (a hand, glare, a torn print): of any square; of a square some of
whose corners weren't found; of such a square that appears as blank paper"""
PAPER = 0.6
"""least share of white modules in a marker's border with which a square appears as blank paper"""
UNLIKE = -30.0
"""bits of evidence for a marker below which the square is treated as hiding it, with an error of a ten-millionth of a
bit"""
SLACK = 0.01
"""bits per square by which evidence computed in single precision may be too low"""


class _Turned(NamedTuple):
    """Squares of a board in the picture rotated by quarter turns, in the form that the kernel reads."""

    own: Array
    black: Array
    covered: Array
    free: Array
    role: Array


_ROLE = constants("gains")
_BLOCK = _ROLE["BLOCK"]
MOST_COLUMNS = _ROLE["COLUMNS"]
"""squares per row of the widest board of which a part can be read"""
_most = bind("rcdn_most_evidence", _Turned)


@dataclass(frozen=True, eq=False)
class TurnedSquares:
    """The K squares with markers of a board of `shape` (rows, columns) squares in the picture rotated by `turns`
    quarter turns: log-likelihood `ratios` (K, m, m) of white to black modules; `row` and `column` (K,), row by row;
    `covered` (K,), probability that a square doesn't show its marker."""

    ratios: Array
    row: Array
    column: Array
    covered: Array
    shape: tuple[int, int]
    turns: int

    def gains(self, family: Family, border: int) -> Real[Array, "k n"]:
        """Evidence (K, N), bits, for each marker in each square."""
        return gains(self.ratios, family.bits, border, self.covered[:, None])


@dataclass(frozen=True, eq=False)
class MarkedSquares:
    """Log-likelihood `ratios` (R, C, m, m) of white to black modules in the squares of a board; `marked` (R, C):
    every second one, which may contain markers with `border` modules around their bits; `inner` (R, C): those all of
    whose corners were found."""

    ratios: Array
    marked: Array
    inner: Array
    border: int

    def turned(self, turns: int) -> TurnedSquares:
        turned = np.rot90(np.rot90(self.ratios, turns, (0, 1)), turns, (2, 3))
        marked = np.rot90(self.marked, turns)
        row, column = np.nonzero(marked)
        shown = turned[row, column]
        covered = _covered(shown, np.rot90(self.inner, turns)[row, column], self.border)
        return TurnedSquares(shown, row, column, covered, (marked.shape[0], marked.shape[1]), turns)

    def most_evidence(self, families: Sequence[Family], least: float, mirrored: bool = False) -> Array:
        """Upper bounds (families, 4), bits, of the evidence for any layout of a board in the picture rotated by 0 to 3
        quarter turns (`mirrored`: in its mirror image), for any first marker, size and position.

        The numbers of markers rise by one from square to square along a row, so that the evidence of a row is at most
        that for the likeliest number of its first square; where the sum of these bounds reaches `least`, all rows are
        evaluated jointly, for every number of columns. The outermost squares may lie beyond the board; those of the
        last row may be absent.
        """
        out = np.zeros((len(families), 4))
        count = int(self.marked.sum())
        if not count:
            return out
        squares = self._all_turns(mirrored)
        width = np.array([self.marked.shape[1 - turns % 2] for turns in range(4)], np.int32)
        for family, most in zip(families, out, strict=True):
            if len(family):
                _most(squares, _bits(family), len(family), width, least - SLACK * count, most)
        return out + SLACK * count

    def _all_turns(self, mirrored: bool) -> _Turned:
        """The squares in the four orientations of the picture, or of its mirror image, in the form that the kernel
        reads."""
        own, alone = self._of_squares
        order, role = _orders(*self.marked.shape, bool(self.marked[0, 0]), mirrored)
        places = _places(own.shape[1], mirrored)
        turned = np.stack([own[row[:, None], at] for row, at in zip(order, places, strict=True)])
        black, covered, free = (values[order] for values in alone)
        return _Turned(turned, black, covered, free, role)

    @cached_property
    def _of_squares(self) -> tuple[Array, Array]:
        """For each square: the evidence of each bit, (K, n²); and (3, K): its evidence if all bits are black, and the
        log2 of the probabilities that it doesn't show its marker, and that it does; float32."""
        shown = self.ratios[self.marked]
        own, black = _parts(shown, inner_modules(shown.shape[-1], self.border))
        covered = _covered(shown, self.inner[self.marked], self.border)
        alone = np.stack([black, np.log2(covered), np.log2(1 - covered)])
        return np.ascontiguousarray(own, np.float32), alone.astype(np.float32)


@lru_cache(maxsize=256)
def _orders(rows: int, columns: int, first: bool, mirrored: bool) -> tuple[Array, Array]:
    """For the picture rotated by quarter turns, or its mirror image: (4, K), the index of each marked square among
    those of the unrotated picture, row by row; and the squares' roles for the kernel. Every second square is marked;
    `first`: the first is."""
    marked = np.add.outer(np.arange(rows), np.arange(columns)) % 2 != first
    number = np.full(marked.shape, -1)
    number[marked] = np.arange(marked.sum())
    at = [np.rot90(number[:, ::-1] if mirrored else number, turns) for turns in range(4)]
    return np.stack([a[a >= 0] for a in at]), np.stack([_roles(a >= 0) for a in at])


@lru_cache
def _places(bits: int, mirrored: bool) -> Array:
    """(4, n²): the index of each of a marker's n² `bits` in the picture rotated by quarter turns, or in its mirror
    image."""
    at = np.arange(bits).reshape(math.isqrt(bits), -1)
    return np.stack([np.rot90(at[:, ::-1] if mirrored else at, turns).ravel() for turns in range(4)])


def _covered(shown: Real[Array, "k m m"], inner: Array, border: int) -> Real[Array, " k"]:
    """Probability (K,) that squares with modules `shown` (K, m, m) don't show their markers."""
    paper = (shown[:, ~inner_modules(shown.shape[-1], border)] > 1).mean(axis=1) > PAPER
    return np.where(inner, COVERED, np.where(paper, BLANK, COVERED_RIM))


def _roles(marked: Bool[Array, "r c"]) -> Array:
    """The roles (K,) of the `marked` (R, C) squares for the kernel: flags of their position in the board."""
    row, column = np.nonzero(marked)
    first = np.diff(row, prepend=-1) > 0
    beside, last = (column == 0) | (column == marked.shape[1] - 1), row == len(marked) - 1
    loose = last | (row == 0)
    flags = zip((first, beside, loose, last), ("FIRST", "BESIDE", "LOOSE", "LAST"), strict=True)
    return np.asarray(sum(of * _ROLE[name] for of, name in flags), np.int32)


@lru_cache
def _bits(family: Family) -> Array:
    """Bits of the markers, (blocks, bits, markers per block) float32."""
    flat = family.bits.reshape(len(family), -1)
    flat = np.pad(flat, ((0, -len(flat) % _BLOCK), (0, 0)))
    return np.ascontiguousarray(flat.reshape(-1, _BLOCK, flat.shape[1]).swapaxes(1, 2), np.float32)


def gains(
    ratios: Real[Array, "k m m"],
    bits: Shaped[Array, "b n n"],
    border: int,
    covered: Real[Array, "k 1"] | float = COVERED,
) -> Real[Array, "k b"]:
    """Evidence (K, N), bits, for each of N markers `bits` (N, n, n) in each of K squares with log-likelihood `ratios`
    (K, m, m) of their modules.

    `covered` (K, 1), or one for all: probability that a square doesn't show its marker.
    """
    own, black = _parts(ratios, inner_modules(ratios.shape[-1], border))
    shown = black[:, None] + own @ bits.reshape(len(bits), -1).T.astype(float)
    known = shown > UNLIKE  # most pairs of square and marker don't match
    covered = np.broadcast_to(covered, shown.shape)
    out = np.log2(covered)
    out[known] = np.log2(covered[known] + (1 - covered[known]) * np.exp2(np.minimum(shown[known], 500)))
    return out


def _parts(ratios: Array, inside: Array) -> tuple[Array, Array]:
    """For squares (K, m, m): the evidence of each bit for white over black, (K, n²) bits; their evidence if all bits
    are black, (K,)."""
    own, frame = ratios[:, inside], ratios[:, ~inside]
    black = _gain(-own).sum(axis=1) + np.minimum(_gain(-frame).sum(axis=1), 0)  # the border of any marker is black
    return own / np.log(2), black


def framed(ratios: Real[Array, "k m m"], border: int) -> float:
    """Evidence, bits, for black borders of markers, of which some may be hidden; `ratios` (K, m, m): log-likelihoods of
    modules."""
    frame = ratios[:, ~inner_modules(ratios.shape[-1], border)]
    black = np.minimum(_gain(-frame).sum(axis=1), 500)
    return float(np.log2(COVERED_RIM + (1 - COVERED_RIM) * np.exp2(black)).sum())


def _gain(ratio: Array) -> Array:
    """Evidence, bits, for a colour with log-likelihood `ratio`, relative to a fair coin."""
    return 1 - np.logaddexp(0, -ratio) / np.log(2)
