"""Completion: adds corners that the graph missed where a grid's neighbours predict them and the image confirms them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field
from rcdn.boards.local import WIDEST, Grid, Offer, Predictions, as_labels, assign, beside
from rcdn.boards.validate import LEAST_QUALITY
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int


class _Rim(NamedTuple):
    """A growing grid as input of the kernel: labels (M, 2) and indices (M,) of its corners, open spots (K, 2) with
    their predictions (K, 6) and shorter steps (K,)."""

    labels: Array
    members: Array
    spots: Array
    maps: Array
    pitch: Array


class _Corners(NamedTuple):
    """A `Field` as input of the kernel, and which corners are `free`."""

    xy: Array
    axes: Array
    polarity: Array
    contrast: Array
    response: Array
    fit: Array
    strong: Array
    refined: Array
    free: Array


class _Rules(NamedTuple):
    """Conditions on new corners: least response × fit, `level`; the board's colouring; largest distances `near`,
    `near_weak`, squares, and largest angle of the axes, `far`; the offers already `refused` (R, 3)."""

    level: float
    sign: int
    near: float
    near_weak: float
    far: float
    refused: Array


class _Offers(NamedTuple):
    """Corners offered to a grid, see `_Growth._near`, and the number of edges, `edges` (1,)."""

    offers: Array
    gap: Array
    fits: Array
    beside: Array
    start: Array
    end: Array
    level: Array
    edges: Array

    @classmethod
    def room(cls, count: int) -> _Offers:
        """Empty arrays for `count` offers."""
        return cls(
            np.empty((count, 3), np.int64), np.empty(count), np.empty(count, np.uint8), np.empty((count, 4), np.int64),
            np.empty((4 * count, 2)), np.empty((4 * count, 2)), np.empty(4 * count), np.zeros(1, np.int64),
        )  # fmt: skip


_sign, _seen = bind("rcdn_grid_sign"), bind("rcdn_grid_seen")
_offers = bind("rcdn_grid_offers", _Rim, _Corners, _Rules, _Offers)
ROUNDS = 40
"""of growth of a grid, at most"""
NEAR, NEAR_WEAK = 0.28, 0.24
"""largest distance of a corner from its prediction, share of the pitch; the second for weak corners"""
PLAIN = 5
"""fewest corners of a grid for which weak peaks are evaluated: a grid of mostly weak corners is no board
(`validate.plain`)"""
ROOM = 64
"""initial capacity for offers"""
MANY = 64
"""from so many corners on, only spots near the last additions are tested again: nothing has changed elsewhere"""
SLACK = 3.0
"""largest displacement of a peak by its refinement, px"""
FAR_AXIS = np.deg2rad(30)
"""how far a corner's axes may turn from the predicted steps"""
SHOWN, SHOWN_WEAK = 0.2, 0.3
"""least contrast of an edge to a labelled neighbour, share of the board's contrast"""


def grow(field: Field, grid: Grid, free: Bool[Array, " n"]) -> None:
    """Add corners to `grid`, nearest to their prediction first, until nothing changes.

    `free` (N,) bool: corners that may be taken; updated. A corner is taken if it lies within 0.28 of a square of its
    prediction (0.24 if it is weak), its axes and colours fit the board where they are known, and the edges to its
    labelled neighbours are visible. No corner is removed and no label is changed.
    """
    sign = board_sign(field, grid)
    if sign == 0:
        return
    growth = _Growth(field, grid, sign, free)
    for _ in range(ROUNDS):
        field.rounds[0] += 1
        offers = growth.offers()
        if not offers:
            return
        growth.added = as_labels(assign(grid.at, free, offers))


def board_sign(field: Field, grid: Grid) -> int:
    """The board's colouring: side colour of the u axis times (−1)^(u+v), by majority; 0 if undecided."""
    votes = np.zeros(1, np.int64)
    _sign(
        grid.labels, grid.corners, grid.xy, field.axes, field.polarity, FAR_AXIS, votes
    )  # filled corners have no colours
    return int(np.sign(votes[0]))


class _Growth:
    """A growing grid. `level`: least quality of a new corner; `refused` (R, 3): u, v and corner of the offers that were
    refused for good; `added` (A, 2): labels of the last round's corners, None before the first."""

    def __init__(self, field: Field, grid: Grid, sign: int, free: Array) -> None:
        self.field, self.grid, self.sign, self.free = field, grid, sign, free
        corners = grid.corners
        self.level = LEAST_QUALITY * median(field.response[corners] * field.fit[corners])
        self.refused = np.zeros((0, 3), np.int64)
        self.added: Array | None = None
        self._room = _Offers.room(ROOM)

    def offers(self) -> list[Offer]:
        """Acceptable corners for the empty spots beside the grid: corners whose edges to the grid's corners are
        visible.

        For a strong corner whose axes fit, one visible edge is enough if no other contradicts it; otherwise all edges
        must be visible, and at least two of them where the axes do not fit (motion blur changes their directions). An
        edge is also visible if its contrast is so close to it, beside the rim that a marker leaves of a square.
        """
        labels, members = self.grid.labels, self.grid.corners
        labels, members, spots, guess = self._open(labels, members)
        if not len(spots):
            return []
        if len(labels) >= PLAIN:
            self.field.evaluate(guess.xy, NEAR * guess.pitch + SLACK)
        offered, gap, fits, near, start, end, level = self._near(labels, members, spots, guess)
        if not len(offered):
            return []
        shown, seen = edge_contrast(self.field.grey, start, end), np.empty(len(offered), np.uint8)
        _seen(shown, level, near, fits, SHOWN, SHOWN_WEAK, seen)
        if not seen.all():
            close = edge_contrast(self.field.grey, start, end, close=True)
            shown = np.where(level[:, None] < 0, np.minimum(shown, close), np.maximum(shown, close))
            _seen(shown, level, near, fits, SHOWN, SHOWN_WEAK, seen)
        if not seen.all():
            self.refused = np.concatenate([self.refused, offered[seen == 0]])
        rows = zip(seen.tolist(), gap.tolist(), offered.tolist(), strict=True)
        return [(gap, (u, v), corner) for ok, gap, (u, v, corner) in rows if ok]

    def _open(self, labels: Array, members: Array) -> tuple[Array, Array, Array, Predictions]:
        """The open spots (K, 2) to be tested, with their predictions, and the labels and corners near them.

        A spot that stayed empty stays empty in the next round, too, unless one of the corners that predict it is new.
        """
        added = self.added
        if added is None or len(labels) < MANY or len(labels) - len(added) <= PLAIN:
            return labels, members, *beside(labels, self.grid.xy[members])
        # spots within WIDEST of the added corners are predicted from labels within WIDEST of the spots
        some = nearest(added, labels)[0][:, 0] <= np.sqrt(2) * 2 * WIDEST + 1
        labels, members = labels[some], members[some]
        spots, guess = beside(labels, self.grid.xy[members])
        row = np.flatnonzero(nearest(added, spots)[0][:, 0] <= np.sqrt(2) * WIDEST + 1e-9)
        return labels, members, spots[row], guess.take(row)

    def _near(self, labels: Array, members: Array, spots: Int[Array, "k 2"], guess: Predictions) -> tuple[Array, ...]:
        """Corners offered to the open `spots` (K, 2).

        Returns u, v and corner (M, 3); distance from the prediction (M,), squares; whether the corner's axes and
        colours fit the predicted steps (M,), 2 for a strong corner; which edges lead to labelled neighbours (M, 4), −1
        for none; and, of these edges, starts and ends (E, 2) px, and the neighbours' contrast (E,), negative where the
        side at rising angle is the dark one.
        """
        field = self.field
        rim = _Rim(labels, members, spots, guess.maps, guess.pitch)
        corners = _Corners(
            field.xy, field.axes, field.polarity, field.contrast, field.response, field.fit,
            *(flag.view(np.uint8) for flag in (field.strong, field.refined, self.free)),
        )  # fmt: skip
        rules = _Rules(self.level, self.sign, NEAR, NEAR_WEAK, FAR_AXIS, self.refused)
        while (count := _offers(rim, corners, rules, self._room)) > len(self._room.gap):
            self._room = _Offers.room(count)
        each, of_edges = self._room[:4], self._room[4:7]
        return *(a[:count] for a in each), *(a[: self._room.edges[0]] for a in of_edges)
