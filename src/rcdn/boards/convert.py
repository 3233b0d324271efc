"""Candidates as input of the recovery, and lattices as boards, whatever their pattern."""

from __future__ import annotations

import numpy as np

from rcdn.boards.graph import Field
from rcdn.boards.grow import board_sign
from rcdn.boards.local import Grid
from rcdn.corners import Candidates
from rcdn.geometry.order import colour_after, turn_of
from rcdn.geometry.rules import CHECKER, Rule
from rcdn.types import Array, Board, Status

ROOM = 4096
"""number of corners that a board may append to those of the image before all positions must be copied"""


def as_field(grey: Array, candidates: Candidates) -> Field:
    """The candidates as input of the board recovery, in their order, followed by the weak peaks."""
    found, seen, peaks = candidates.all, candidates.orientation, candidates.peaks
    more = 0 if peaks is None else len(peaks.xy)
    count = len(found) + more
    room = np.empty((count + ROOM + count // 4, 2))
    room[: len(found)] = found.xy
    room[len(found) : count] = peaks.xy if peaks is not None else 0
    longer = lambda a, value: np.concatenate([a, np.full((more, *a.shape[1:]), value, a.dtype)])  # noqa: E731
    return Field(
        np.ascontiguousarray(grey),
        room[:count],
        longer(seen.axes, np.nan),
        longer(seen.polarity.astype(int), 0),
        longer(seen.contrast, 0),
        longer(seen.fit, 0),
        found.response if peaks is None else np.concatenate([found.response, peaks.score]),
        longer(candidates.seed, False),
        longer(found.status != Status.SEED, False),
        peaks,
        np.arange(count) >= len(found),
    )


def as_board(field: Field, candidates: Candidates, grid: Grid, rule: Rule = CHECKER, sign: int | None = None) -> Board:
    """A right-handed grid of corners as a board labelled by the contract. Filled corners have response 0.

    `sign`: +1 if the cell of the grid's lattice at the label (0, 0) is bright, −1 if dark, 0 if undecided; None: by the
    corners of a board of squares. Tags have no colours and begin at even labels: their codes must determine which
    corner is the first.
    """
    ij, index = grid.labels, grid.corners
    # the side colour of u at (0, 0) is the colour of the square towards +v, which lies between (0, 0) and (1, 1)
    sign = board_sign(field, grid) if sign is None else sign
    turn = 0 if rule.period > 1 else turn_of(ij, grid.xy[index], sign, rule)
    dark = colour_after(ij, sign, turn) < 0 if sign and rule is CHECKER else None
    ij = rule.started(rule.turned(ij, turn))
    cols, rows = (ij.max(axis=0) + 1).tolist()
    # without colours the orientation of squares is undecided
    orientation = rule.orientation(cols, rows) if sign or rule is not CHECKER else "ambiguous_180"
    order = np.lexsort((ij[:, 0], ij[:, 1]))
    index, ij = index[order], ij[order]
    # filled corners have no entry in `field`; weak peaks have none in `candidates`
    seen, known = index < len(field.xy), index < len(candidates.all)
    response, status = np.zeros(len(index)), np.full(len(index), Status.COMPLETED, np.uint8)
    response[seen] = field.response[index[seen]]
    status[seen] = np.where(field.refined[index[seen]], Status.COMPLETED, Status.SEED)
    own = candidates.all.status[index[known]]
    status[known] = np.where(~candidates.sure[index[known]] & (own == Status.REFINED), Status.COMPLETED, own)
    height, width = field.grey.shape
    return Board(
        grid.xy[index], ij, (width, height), response, status, orientation, pattern=rule.pattern, origin_dark=dark
    )
