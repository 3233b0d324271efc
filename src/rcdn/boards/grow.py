"""Completion: corners that the graph missed, where a grid's neighbours predict them and the picture agrees."""

from __future__ import annotations

import numpy as np

from rcdn.boards.edges import edge_contrast
from rcdn.boards.graph import Field, Label
from rcdn.boards.local import Grid, Predictions, checked
from rcdn.boards.validate import LEAST_QUALITY
from rcdn.native import bind
from rcdn.types import Array

_sign = bind("rcdn_grid_sign", "lddlnrL", result=True)
_offers = bind("rcdn_grid_offers", "llnlddnddldbbnlnnrrrLDBLDDDn", result=True)
_seen = bind("rcdn_grid_seen", "ddlbnrrB")
ROUNDS = 40
NEAR, NEAR_WEAK = 0.28, 0.24
"""a corner may lie this share of the pitch from its prediction; a weak one must be closer"""
PLAIN = 5
"""corners that a grid must have before weak peaks are looked at: no board is one whose corners are mostly weak (`validate.plain`)"""
ROOM = 16
"""corners near an open spot that are usual"""
SLACK = 3.0
"""px by which refinement may move a peak"""
FAR_AXIS = np.deg2rad(30)
SHOWN, SHOWN_WEAK = 0.2, 0.3
"""share of the board's contrast that an edge to a labelled neighbour shows"""


def grow(field: Field, grid: Grid, free: Array) -> None:
    """Add corners to `grid`, nearest to their prediction first, until nothing changes. `free` (N,) bool: corners that may be taken; updated.

    A corner is taken if it lies within 0.28 of a square of its prediction (0.24 if it is weak), its axes and colours fit the
    board where they are known, and the edges to its labelled neighbours are in the picture. Drops nothing and renames nothing.
    """
    sign = board_sign(field, grid)
    if sign == 0:
        return
    growth = _Growth(field, grid, sign, free)
    for _ in range(ROUNDS):
        offers = growth.offers()
        if not offers:
            return
        taken: set[int] = set()
        for _, spot, corner in sorted(offers):
            if spot not in grid.at and corner not in taken:
                grid.at[spot] = corner
                taken.add(corner)
                free[corner] = False


def board_sign(field: Field, grid: Grid) -> int:
    """The board's colouring: side colour of the u axis times (−1)^(u+v), by majority; 0 if undecided."""
    labels, corners, votes = grid.labels, grid.corners, np.zeros(1, np.int64)
    own = np.minimum(corners, len(field.xy) - 1)
    polarity = np.where(corners < len(field.xy), field.polarity[own], 0)  # filled corners have no colours
    checked(_sign(labels, grid.xy[corners], field.axes[own], polarity, len(labels), FAR_AXIS, votes))
    return int(np.sign(votes[0]))


Offer = tuple[float, Label, int]
"""a corner that might take a spot: its distance from the prediction, in squares; the spot; the corner"""


class _Growth:
    """A grid that goes on. `level`: least quality of a new corner; `refused` (R, 3): u, v and corner of what was offered and isn't asked again."""

    def __init__(self, field: Field, grid: Grid, sign: int, free: Array) -> None:
        self.field, self.grid, self.sign, self.free = field, grid, sign, free
        corners = grid.corners
        self.level = LEAST_QUALITY * float(np.median(field.response[corners] * field.fit[corners]))
        self.refused = np.zeros((0, 3), np.int64)

    def offers(self) -> list[Offer]:
        """Acceptable corners for the empty spots beside the grid: their edges to its corners are in the picture.

        One is enough for a strong corner whose axes fit, if none speaks against it; otherwise all must be seen, and two at least
        where the axes don't fit (motion blur bends them).
        """
        spots, guess = self.grid.beside()
        if not len(spots):
            return []
        if len(self.grid) >= PLAIN:
            self.field.look(guess.xy, NEAR * guess.pitch + SLACK)
        offers, gap, fits, beside, start, end, level = self._near(spots, guess)
        if not len(offers):
            return []
        shown, seen = edge_contrast(self.field.grey, start, end), np.empty(len(offers), np.uint8)
        _seen(shown, level, beside, fits, len(offers), SHOWN, SHOWN_WEAK, seen)
        asked = np.concatenate([spots[offers[:, 0]], offers[:, 1:]], axis=1)
        self.refused = np.concatenate([self.refused, asked[seen == 0]])
        rows = zip(seen.tolist(), gap.tolist(), asked.tolist(), strict=True)
        return [(gap, (u, v), corner) for ok, gap, (u, v, corner) in rows if ok]

    def _near(self, spots: Array, guess: Predictions) -> tuple[Array, ...]:
        """What the open `spots` (K, 2) may be offered: numbers of spots and corners (M, 2); their distance from the prediction (M,), squares;
        do their own axes and colours fit the predicted steps (M,), 2: of a strong corner; which edges lead to labelled neighbours (M, 4), −1 for
        none. Of these edges, starts and ends (E, 2) px, and the neighbours' contrast (E,), negative where the side at rising angle is the dark one.
        """
        field, labels, members, room = self.field, self.grid.labels, self.grid.corners, ROOM + len(spots)
        usable = self.free & (field.refined | field.strong) & (field.response * field.fit >= self.level)
        while True:
            offers, gap, fits = np.empty((room, 2), np.int64), np.empty(room), np.empty(room, np.uint8)
            beside, level = np.empty((room, 4), np.int64), np.empty(4 * room)
            start, end = np.empty((4 * room, 2)), np.empty((4 * room, 2))
            count = checked(
                _offers(
                    labels, members, len(labels), spots, guess.maps, guess.pitch, len(spots),
                    field.xy, field.axes, field.polarity, field.contrast, field.strong.view(np.uint8), usable.view(np.uint8), len(usable),
                    self.refused, len(self.refused), self.sign, NEAR, NEAR_WEAK, FAR_AXIS,
                    offers, gap, fits, beside, start, end, level, room,
                )
            )  # fmt: skip
            if count <= room:
                edges = int(beside[:count].max(initial=-1)) + 1
                return (
                    offers[:count],
                    gap[:count],
                    fits[:count],
                    beside[:count],
                    start[:edges],
                    end[:edges],
                    level[:edges],
                )
            room = count
