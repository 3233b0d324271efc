"""Completion: adds corners that the graph missed where a grid's neighbours predict them and the image confirms them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.graph import Field
from rcdn.boards.local import Grid, Predictions, beside
from rcdn.boards.validate import LEAST_QUALITY
from rcdn.geometry.median import median
from rcdn.geometry.rules import Label
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
    `near_weak`, squares, and largest angle of the axes, `far`; least contrasts of edges, `least`, `least_weak`; the
    offers already `refused` (R, 3)."""

    level: float
    sign: int
    near: float
    near_weak: float
    far: float
    least: float
    least_weak: float
    refused: Array


_sign = bind("rcdn_grid_sign")
_round = bind("rcdn_grid_round", _Rim, _Corners, _Rules)
ROUNDS = 40
"""of growth of a grid, at most"""
NEAR, NEAR_WEAK = 0.28, 0.24
"""largest distance of a corner from its prediction, share of the pitch; the second for weak corners"""
PLAIN = 5
"""fewest corners of a grid for which weak peaks are evaluated: a grid of mostly weak corners is no board
(`validate.plain`)"""
ROOM = 64
"""initial capacity for refused offers"""
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
        if not growth.advance():
            break
    grid.at |= growth.added_corners()


def board_sign(field: Field, grid: Grid) -> int:
    """The board's colouring: side colour of the u axis times (−1)^(u+v), by majority; 0 if undecided."""
    votes = np.zeros(1, np.int64)
    _sign(
        grid.labels, grid.corners, grid.xy, field.axes, field.polarity, FAR_AXIS, votes
    )  # filled corners have no colours
    return int(np.sign(votes[0]))


class _Growth:
    """A growing grid. `labels` (M, 2) and `corners` (M,): its own, the first `before` of which it began with; `level`:
    least quality of a new corner; `refused` (R, 3): u, v and corner of the offers that were refused for good; `added`
    (A, 2): labels of the last round's corners, None before the first."""

    def __init__(self, field: Field, grid: Grid, sign: int, free: Array) -> None:
        self.field, self.xy, self.sign, self.free = field, grid.xy, sign, free
        self.labels, self.corners, self.before = grid.labels, grid.corners, len(grid)
        self.level = LEAST_QUALITY * median(field.response[self.corners] * field.fit[self.corners])
        self.refused = np.zeros((0, 3), np.int64)
        self.added: Array | None = None

    def added_corners(self) -> dict[Label, int]:
        """What was added, {(u, v): corner}."""
        spots, corners = self.labels[self.before :].tolist(), self.corners[self.before :].tolist()
        return {(u, v): corner for (u, v), corner in zip(spots, corners, strict=True)}

    def advance(self) -> bool:
        """Add the acceptable corners for the empty spots beside the grid, nearest to their prediction first; False if
        there is none.

        For a strong corner whose axes and colours fit, one visible edge to a labelled neighbour is enough if no other
        contradicts it; otherwise all edges must be visible, and at least two of them where the axes do not fit (motion
        blur changes their directions). An edge is also visible if its contrast is so close to it, beside the rim that a
        marker leaves of a square.
        """
        spots, guess = self._open()
        if not len(spots):
            return False
        if len(self.labels) >= PLAIN:
            self.field.evaluate(guess.xy, NEAR * guess.pitch + SLACK)
        added, refused = self._offered(spots, guess)
        if len(refused):
            self.refused = np.concatenate([self.refused, refused])
        self.labels = np.concatenate([self.labels, added[:, :2]])
        self.corners = np.concatenate([self.corners, added[:, 2]])
        self.added = np.ascontiguousarray(added[:, :2])
        return len(added) > 0

    def _open(self) -> tuple[Array, Predictions]:
        """The empty spots (K, 2) to be tested, with their predictions.

        A spot that stayed empty stays empty in the next round, too, unless one of the corners that predict it is new.
        """
        few = self.added is None or len(self.labels) < MANY or len(self.labels) - len(self.added) <= PLAIN
        return beside(self.labels, self.xy[self.corners], None if few else self.added)

    def _offered(self, spots: Int[Array, "k 2"], guess: Predictions) -> tuple[Array, Array]:
        """Corners for the empty `spots` (K, 2) that are added, (A, 3) u, v, corner, and those that are refused, (R,
        3)."""
        field = self.field
        rim = _Rim(self.labels, self.corners, spots, guess.maps, guess.pitch)
        corners = _Corners(
            field.xy, field.axes, field.polarity, field.contrast, field.response, field.fit,
            *(flag.view(np.uint8) for flag in (field.strong, field.refined, self.free)),
        )  # fmt: skip
        rules = _Rules(self.level, self.sign, NEAR, NEAR_WEAK, FAR_AXIS, SHOWN, SHOWN_WEAK, self.refused)
        added, counts, room = np.empty((len(spots), 3), np.int64), np.empty(1, np.int64), ROOM
        while (many := _round(field.grey, rim, corners, rules, added, refused := _room(room), counts)) > room:
            room = many
        return added[: counts[0]], refused[:many]


def _room(count: int) -> Array:
    return np.empty((count, 3), np.int64)
