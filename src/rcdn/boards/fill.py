"""Corners that the network missed, found in the image where a finished board predicts them.

A hard shadow, glare or a scratch across a corner may suppress the network's response, and at the image border or an
occluder little of the corner is visible; the board's two edges still cross there, and this crossing is searched for
(`edges.crossings`). Nothing is invented: an edge must be visible on both sides of the crossing, about as strongly as at
the labelled neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.boards.edges import crossings
from rcdn.boards.graph import Field
from rcdn.boards.grow import SLACK
from rcdn.boards.local import LEAST_PITCH, WIDEST, Grid, Predictions, as_labels, windows
from rcdn.boards.validate import predicted_excess
from rcdn.geometry.matrices import inverse, product
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import Label
from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

_typical = bind("rcdn_grid_usual")
ROUNDS = 8
"""of filling, at most"""
LEAST_SUPPORT = 5
"""fewest labelled neighbours that a prediction needs"""
SEEN, SEEN_RIM = 0.35, 0.5
"""least strength of both edges, share of the neighbours' median; the second where the board would grow beyond its
rim"""
SEEN_ONE = 0.6
"""the same for the stronger edge of a corner between four labelled ones, where a shadow may run along the other edge"""
CLOSE = 0.06
"""largest offset of that edge, squares"""
OFF = 0.14
"""largest offset from the prediction, squares"""
ANSWER = 0.6
"""least response of a candidate beyond the rim, share of the board's median"""
REACH_PX, ANSWERED = 1.5, 0.06
"""a candidate within the larger of these distances from a crossing is the corner there, px and squares"""
BESIDES = (3, 5, 1, 7)
"""indices of the left, right, upper and lower neighbour in a 3 × 3 window of labels"""
BESIDE_PX, BESIDE = 2.5, (0.02, 0.035)
"""a labelled corner further than so many px, clipped to these squares, from its crossing is a corner of something
else"""


class Spots(NamedTuple):
    """Labels `at` (K, 2) with their neighbours' predictions."""

    at: Array
    guess: Predictions

    def crossings(self, grey: Array, sign: int) -> tuple[Array, Array]:
        """Offsets (K, 2), squares, of the crossings at these spots, and their strengths (K, 2)."""
        colour = sign * (1.0 - 2 * (self.at.sum(axis=1) % 2))
        return crossings(grey, self.guess.xy, self.guess.du, self.guess.dv, colour)


class _Seen:
    """Strengths of a board's two edges, `strength` (K, 2), at labels `at` (K, 2)."""

    def __init__(self, at: Array, strength: Array) -> None:
        self.at, self.strength = at, strength

    def add(self, at: list[Label], strength: list[Array]) -> None:
        """Append further strengths and their labels."""
        self.at = np.concatenate([self.at, as_labels(at)])
        self.strength = np.concatenate([self.strength, strength])

    def shares(self, at: Int[Array, "k 2"], strength: Real[Array, "k 2"]) -> Array:
        """`strength` (K, 2) at labels `at` (K, 2) ÷ the median of the known ones within two squares; 0 where none is
        known."""
        typical, at = np.empty((len(at), 2)), as_labels(at)
        _typical(self.at, np.ascontiguousarray(self.strength), at, typical)
        fine = (typical > 0).all(axis=1, keepdims=True)
        return np.where(fine, strength / np.where(fine, typical, 1), 0)


def fill(field: Field, grid: Grid, sign: int, free: Bool[Array, " n"]) -> None:
    """Add corners to `grid`, in place, and correct those that lie beside their crossing.

    A candidate that is `free` (N,) bool and lies on a crossing is taken, and marked as such; otherwise the crossing's
    position is appended to `grid.xy`. `sign`: the board's colouring (`grow.board_sign`); 0 changes nothing.
    Corners that complete no cell are accepted, since occluders and the image border leave such corners.
    """
    if sign == 0:
        return
    plain = ANSWER * median(field.response[grid.corners])
    known = _set_right(field, grid, sign)
    added: list[Label] = []
    for _ in range(ROUNDS):
        spots, guess = grid.beside()
        some = with_sense(guess)
        new = _accepted(field, grid, sign, Spots(spots[some], guess.take(some)), known, free, plain)
        if not new:
            break
        known.add(list(new), [strength for _, _, strength in new.values()])
        bare: list[Array] = []
        for at, (xy, corner, _) in new.items():
            if corner is None or not free[corner]:
                grid.at[at] = len(grid.xy) + len(bare)
                bare.append(xy)
            else:
                grid.at[at], free[corner] = corner, False
        grid.append(bare, field.xy)
        added += new
    _drop_misfits(grid, sorted(added))


def _drop_misfits(grid: Grid, added: list[Label]) -> None:
    """Remove those `added` corners that lie too far from their neighbours' prediction, worst first."""
    excess = dict(zip(added, predicted_excess(grid, added).tolist(), strict=True))
    changed: set[Label] = set()  # spots near a removed corner: the residuals of all others are unchanged
    for at in sorted(added, key=lambda a: (-excess[a], a)):
        if at in changed:
            near = Grid({spot: grid.at[spot] for spot in _around(at) if spot in grid.at}, grid.xy)
            excess[at] = predicted_excess(near, [at])[0]
        if excess[at] > 1:
            del grid.at[at]
            changed.update(_around(at))


def _around(at: Label) -> list[Label]:
    """The labels that a prediction at `at` may use, and `at` itself."""
    return [(at[0] + d, at[1] + e) for d in range(-WIDEST, WIDEST + 1) for e in range(-WIDEST, WIDEST + 1)]


def _set_right(field: Field, grid: Grid, sign: int) -> _Seen:
    """Move corners to the crossing beside which they lie; returns the edge strengths at all corners.

    The edge of a shadow forms a junction with each edge of the board that it crosses; one near a corner may have been
    taken for that corner.
    """
    labels = grid.labels
    order = np.lexsort((labels[:, 1], labels[:, 0]))
    guess = grid.predictions(labels[order])
    some = with_sense(guess)
    spots = Spots(labels[order][some], guess.take(some))
    offset, strength = spots.crossings(field.grey, sign)
    known = _Seen(spots.at, strength)
    steps = np.stack([spots.guess.du, spots.guess.dv], axis=2)
    here = grid.xy[grid.corners[order][some]] - spots.guess.xy
    own = product(inverse(steps), here[..., None])[..., 0]
    limit = np.clip(BESIDE_PX / spots.guess.pitch, *BESIDE)
    most, found = np.abs(own).max(axis=1), np.abs(offset).max(axis=1)
    beside = np.flatnonzero((np.abs(own - offset).max(axis=1) > limit) & (most > 1.5 * found) & (found <= OFF))
    if not len(beside):
        return known
    seen = known.shares(spots.at[beside], strength[beside]).min(axis=1) >= SEEN
    moved = beside[seen].tolist()
    grid.at |= {(u, v): len(grid.xy) + n for n, (u, v) in enumerate(spots.at[moved].tolist())}
    grid.append([spots.guess.xy[k] + product(steps[k], offset[k, :, None])[:, 0] for k in moved], field.xy)
    return known


def with_sense(guess: Predictions) -> Array:
    """Indices of the predictions with enough supporting neighbours and steps that span the plane."""
    area = np.abs(guess.du[:, 0] * guess.dv[:, 1] - guess.du[:, 1] * guess.dv[:, 0])
    return np.flatnonzero((guess.support >= LEAST_SUPPORT) & (guess.pitch >= LEAST_PITCH) & (area > 1))


def _accepted(
    field: Field, grid: Grid, sign: int, spots: Spots, known: _Seen, free: Array, plain: float
) -> dict[Label, tuple[Array, int | None, Array]]:
    """Position (2,), candidate and strengths (2,) at the spots where the board's edges are seen to cross.

    Beyond its rim a board gives no evidence of its own: there only candidates with a response of at least `plain` are
    accepted.
    """
    offset, strength = spots.crossings(field.grey, sign)
    share = known.shares(spots.at, strength)
    least, most = share.min(axis=1, initial=np.inf), share.max(axis=1, initial=0)
    left, right, above, below = (windows(grid.labels, spots.at, 1)[:, BESIDES] >= 0).T
    within = (left & right) | (above & below)
    far = np.abs(offset).max(axis=1, initial=0)
    # where one edge shows that the colours alternate, the other edge is taken to be at its predicted place
    one = left & right & above & below & ((least < SEEN) | (far > OFF))
    offset = np.where(one[:, None] & (share < most[:, None]), 0, offset)
    far = np.abs(offset).max(axis=1, initial=0)
    seen = np.where(
        one, (most >= SEEN_ONE) & (far <= CLOSE), (least >= np.where(within, SEEN, SEEN_RIM)) & (far <= OFF)
    )
    xy = spots.guess.xy + offset[:, :1] * spots.guess.du + offset[:, 1:] * spots.guess.dv
    out: dict[Label, tuple[Array, int | None, Array]] = {}
    some = np.flatnonzero(seen)
    for k, corner in zip(some.tolist(), _candidates(field, grid, spots, xy, some, free), strict=True):
        if within[k] or (corner is not None and field.response[corner] >= plain):
            u, v = spots.at[k].tolist()
            out[u, v] = xy[k], corner, strength[k]
    return out


def _candidates(
    field: Field, grid: Grid, spots: Spots, xy: Array, some: Int[Array, " j"], free: Array
) -> list[int | None]:
    """The free candidate on the crossing `xy` at each of `some` (J,) spots, or None."""
    reach = np.maximum(REACH_PX, ANSWERED * spots.guess.pitch[some])
    field.evaluate(xy[some], reach + SLACK)
    if not np.shares_memory(grid.xy, field.xy):
        grid.xy[: len(free)] = field.xy
    if not len(some):
        return []
    seen = free if field.waiting is None else free & ~field.waiting
    index = field.near(seen, xy[some], float(reach.max()))
    gap, near = nearest(field.xy[index], xy[some])
    row = np.append(index, -1)[near[:, 0]]
    return [corner if close else None for corner, close in zip(row.tolist(), (gap[:, 0] < reach).tolist(), strict=True)]
