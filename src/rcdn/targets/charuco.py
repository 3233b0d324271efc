"""Reads unknown ChArUco boards: finds the layout of markers for which all squares together are most likely.

Each module of a marker has a log-likelihood ratio of white to black. A layout (dictionary, orientation, size, position)
determines the bits in all squares; its evidence is log2 of the likelihood ratio of these bits to fair coins. If the
bits were fair coins, the evidence for one layout would exceed T with a probability of at most 2^−T (Markov), and that
for any of M layouts with at most M · 2^−T.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rcdn.targets.charuco_layouts import Layout, Scores
from rcdn.targets.families import Family, families, family_of
from rcdn.targets.gains import MarkedSquares, framed
from rcdn.targets.marker import Appearance, Frame, appearance, evidence, modules
from rcdn.targets.reading import Reading
from rcdn.types import Array, Charuco
from rcdn.types.arrays import Bool, Real

ACCEPT = 49.0
"""bits of evidence with which a layout is accepted: a false-positive probability of 10⁻⁶ (20 bits) over fewer than 2²⁹
layouts (4 orientations, 10 families, 2 parities, 62 widths, 2,000 positions, 4 rims; 9 looks at boards and pieces)"""
SURE = 23.0
"""bits of evidence with which a single layout is accepted: 10⁻⁶, for 8 pieces"""
MIRRORED = ACCEPT / 2
"""bits: the mirror image is searched if the bound on the evidence for a layout in it, computed from the picture itself,
is at least this high"""
MARGIN = 14.0
"""bits by which the evidence for a layout must exceed that for the next one"""
ENDED = 20.0
"""bits by which a board is less likely to continue where paper is seen at the edge of its squares (a cut or an occluder
along exactly that edge)"""
RIMS = 4
"""layouts of one position that differ in which outermost squares are on the board"""
SIDES = (4, 5, 6, 7)
"""bits along a marker's side"""
FRAME = Frame()
FRAMED = 16.0
"""least evidence for the black borders of all markers together, bits: textures and drawings have none, boards
hundreds"""


@dataclass(frozen=True, eq=False)
class Markers:
    """The evidence of a board's squares, if they contain markers of `families`: their modules in `squares`, and the
    `appearance` of the markers."""

    squares: MarkedSquares
    appearance: Appearance
    families: tuple[Family, ...]

    @cached_property
    def bounds(self) -> Real[Array, "f 4"]:
        """Upper bounds (families, 4), bits, of the evidence for any layout, for each number of quarter turns."""
        return np.asarray(self.squares.most_evidence(self.families, ACCEPT - MARGIN))


def markers_of(
    squares: Real[Array, "r c s s"],
    marked: Bool[Array, "r c"],
    inner: Bool[Array, "r c"],
    aspect: float,
    given: Charuco | None = None,
) -> list[Markers]:
    """The evidence of a board's squares for markers: one result for each number of bits that a marker may have, if the
    squares have black borders as markers do.

    `squares` (R, C, S, S): grey level above that of the dark squares around each, NaN outside the picture; `marked`
    (R, C): the squares that contain markers; `inner` (R, C): those all of whose corners were detected; `aspect`: their
    width ÷ height in pixels; `given`: the board given by the user (None: unknown).
    """
    out = []
    known = None if given is None else (family_of(given.dictionary),)
    mean, shown, open_sides = np.nanmean(squares[marked & inner], axis=0), squares[marked], _open_sides(marked)[marked]
    for side in SIDES if known is None else (known[0].bits.shape[1],):
        measured = appearance(mean, side, FRAME, aspect)
        if measured is not None:
            ratios = np.zeros((*marked.shape, side + 2, side + 2))
            seen = modules(shown, measured, side, FRAME, open_sides)
            ratios[marked] = evidence(seen, FRAME.border, inner[marked])
            if framed(ratios[marked], FRAME.border) >= FRAMED:
                out.append(
                    Markers(MarkedSquares(ratios, marked, inner, FRAME.border), measured, known or families(side))
                )
    return out


def read_charuco(
    markers: Sequence[Markers],
    given: Charuco | None = None,
    ends: Array | None = None,
    ended: Callable[[float], Array] | None = None,
) -> Reading | None:
    """The layout of the `markers` of a board, or None if none is certain; of one that is, see `Reading.contradicted`.

    `given`: the board given by the user (None: unknown); `ends`: see `ends_of`, or None if the board may extend
    beyond its detected corners; `ended` returns (3, 3) bool from the contrast, see `ended_sides`; None: False on all
    sides.
    """
    if given is not None:
        scored = [s for m in markers for s in _promising(m, np.ones((len(m.families), 4), bool))]
        return _place(scored, given, markers[0].squares.marked.shape, ended) if scored else None
    scored = [s for m in markers for s in _promising(m, m.bounds >= ACCEPT - MARGIN) if s.hope > ACCEPT]
    if not scored:
        return None
    scored.sort(key=lambda s: -s.hope)
    sides = np.zeros((3, 3), bool) if ended is None else ended(abs(scored[0].appearance.white))
    return _best(scored, markers[0].squares.marked.shape, ends, sides)


def may_be_read(markers: Sequence[Markers]) -> bool:
    """Whether the bound of the evidence for any layout of the `markers` reaches the threshold."""
    return any((m.bounds >= ACCEPT).any() for m in markers)


def may_be_mirrored(markers: Sequence[Markers]) -> bool:
    """Whether a layout may be certain in the mirror image of the picture: the bound of its evidence, computed from the
    picture itself, reaches half of the threshold.

    The mirror image is sampled again, which changes its evidence by a few bits.
    """
    return any((m.squares.most_evidence(m.families, MIRRORED, mirrored=True) >= MIRRORED).any() for m in markers)


def _promising(markers: Markers, able: Bool[Array, "f 4"]) -> list[Scores]:
    """Evidence of the families and orientations that are `able` (families, 4) to have a certain layout."""
    squares = markers.squares
    turned = {turns: squares.turned(turns) for turns in np.flatnonzero(able.any(axis=0)).tolist()}
    return [
        Scores(t.gains(family, FRAME.border), t.row, t.column, t.shape, markers.appearance, family, turns)
        for family, row in zip(markers.families, able, strict=True)
        for turns, t in turned.items()
        if row[turns]
    ]


def _open_sides(marked: Array) -> Bool[Array, "r c 4"]:
    """(R, C, 4) bool: whether a square is the outermost one on the left, right, upper, lower side."""
    rows, columns = np.indices(marked.shape)
    last = marked.shape[0] - 1, marked.shape[1] - 1
    return np.stack([columns == 0, columns == last[1], rows == 0, rows == last[0]], axis=-1)


def ends_of(squares: Array, inner: Array) -> Bool[Array, "r c"]:
    """(R, C) bool: whether a board whose last marker lies in this outermost square ends there.

    That is so if all corners were detected and the square lies in the picture, where further corners would have been
    detected.
    """
    return np.asarray(np.isfinite(squares).all(axis=(2, 3)) & inner[1:-1, 1:-1].all())


def _best(scored: list[Scores], shape: tuple[int, ...], ends: Array | None, ended: Array) -> Reading | None:
    """The most likely layout, if it is certain: one whose markers are counted from 0, unless that of a whole board that
    starts at another number is likelier.

    For the latter, paper must be seen above the first row and on both sides (`ended`); otherwise there may be more rows
    or columns, hidden or cut off. No side that is seen may contradict the layout, since a part of a larger board with
    another first number could look the same. A part of a board, without `ends`, can't be known to be whole.
    """
    zero_based = _likeliest(scored, shape, ends, ended, any_first=False)
    if (not zero_based or zero_based[0].bits < ACCEPT) and (ends is None or ended.sum() < 3):
        return None  # a board not counted from 0 must be seen whole
    whole = _likeliest(scored, shape, ends, ended, any_first=True)
    from_0 = bool(zero_based) and (not whole or zero_based[0].bits >= whole[0].bits)
    layouts = zero_based if from_0 else sorted(whole + zero_based[:1], key=lambda x: -x.bits)
    if not layouts or layouts[0].bits < ACCEPT or _against(layouts[0], layouts[0].columns, shape, ended):
        return None
    if not from_0 and (ends is None or not _seen_whole(np.rot90(ended, layouts[0].turns))):
        return None
    margin = layouts[0].bits - (layouts[1].bits if len(layouts) > 1 else 0.0)
    if margin <= MARGIN:
        return None
    return _reading(layouts[0], _rows(layouts[0], ends), margin)


def _seen_whole(ended: Array) -> bool:
    """Whether paper is seen above a board and on both its sides, so that its first square is known."""
    return bool(ended[0, 1] and ended[1, 0] and ended[1, 2])


def _place(
    scored: list[Scores], given: Charuco, shape: tuple[int, ...], ended: Callable[[float], Array] | None
) -> Reading | None:
    """The likeliest position on the `given` board, or, where that explains more by `MARGIN`, on the same one of the
    other layout (legacy or not): few know which of them is theirs. Moved by a column, both may explain the same
    markers; sides at which the board is seen to end then decide."""
    usable = [s for s in scored if (s.appearance.white < 0) == given.inverted]
    own, other = (_place_on(usable, board) for board in (given, replace(given, legacy=not given.legacy)))
    if own is None or other is None:
        return own or other
    sides = np.zeros((3, 3), bool) if ended is None else ended(abs(usable[0].appearance.white))
    bits = [r.bits - ENDED * _against(r, given.columns, shape, sides) for r in (own, other)]
    return other if bits[1] > bits[0] + MARGIN else own


def _place_on(scored: list[Scores], given: Charuco) -> Reading | None:
    """The likeliest position on the `given` board, if it is certain among all positions and orientations on that
    board."""
    count = 0
    layouts: list[Layout] = []
    for scores in scored:
        places = scores.places_on(given)
        count += len(places)
        layouts += scores.scored(places, given.rows)
    layouts.sort(key=lambda x: -x.bits)
    if not layouts or layouts[0].bits < SURE + np.log2(RIMS * count):
        return None
    top, margin = layouts[0], layouts[0].bits - (layouts[1].bits if len(layouts) > 1 else 0.0)
    return Reading(given, top.turns, top.place, top.bits, margin, top.contradicted) if margin > MARGIN else None


def _likeliest(
    scored: list[Scores], shape: tuple[int, ...], ends: Array | None, ended: Array, any_first: bool
) -> list[Layout]:
    layouts: list[Layout] = []
    for scores in scored:
        if layouts and scores.hope < layouts[0].bits - MARGIN:
            break  # no remaining layout can come near the best one
        found = (_weighed(x, shape, ended) for x in filter(_possible(ends), scores.layouts(any_first)))
        layouts = sorted([*layouts, *found], key=lambda x: -x.bits)
    return layouts


def _weighed(layout: Layout, shape: tuple[int, ...], ended: Array) -> Layout:
    return replace(layout, bits=layout.bits - ENDED * _against(layout, layout.columns, shape, ended))


def _against(at: Layout | Reading, columns: int, shape: tuple[int, ...], ended: Array) -> int:
    """The number of sides on which a board of so many `columns` is seen to end (`ended`) with the squares of `shape`
    (R, C), but doesn't according to the turns and the place of these squares `at` which it is taken to be."""
    sides, (u, v) = np.rot90(ended, at.turns), at.place
    width = shape[1 - at.turns % 2]
    return int(sides[0, 1] and v != 0) + int(sides[1, 0] and u != 0) + int(sides[1, 2] and u + width != columns)


def _rows(layout: Layout, ends: Array | None) -> int | None:
    """The number of rows of the board; None if there may be more rows outside the detected ones."""
    if ends is None or not layout.last_row or not np.rot90(ends, layout.turns)[-1].all():
        return None
    return layout.place[1] + ends.shape[layout.turns % 2]


def _possible(ends: Array | None) -> Callable[[Layout], bool]:
    """A predicate for layouts that exist in print: a first square with a marker (legacy) requires an even or
    unknown number of rows."""
    return lambda layout: layout.odd or (_rows(layout, ends) or 0) % 2 == 0


def _reading(top: Layout, rows: int | None, margin: float) -> Reading:
    target = Charuco(
        top.columns,
        rows,
        top.family.smallest(top.highest),
        round(top.appearance.ratio, 2),
        top.first,
        legacy=not top.odd,
        inverted=top.appearance.white < 0,
    )
    return Reading(target, top.turns, top.place, top.bits, margin, top.contradicted)
