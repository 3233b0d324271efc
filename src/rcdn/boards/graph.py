"""The validated link graph: links between neighbouring corners, and the cells formed by four of them.

All tests are local: no line, no homography and no board size is assumed, so that distorted, bent, cut and several
boards need no special treatment.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from rcdn.corners.peaks import SAME, Peaks
from rcdn.geometry.boxes import PointCells
from rcdn.geometry.elementary import arctan2, cos_sin
from rcdn.geometry.near import nearest, pairs, within
from rcdn.geometry.rules import CHECKER, Label, Rule
from rcdn.native import bind
from rcdn.types import Array, Status
from rcdn.types.arrays import Bool, Int, Real

_links = bind("rcdn_links")
_boxed = bind("rcdn_inside")
_mutual = bind("rcdn_mutual")
_cells = bind("rcdn_cells")
_label = bind("rcdn_label")

NEIGHBOURS = 30
"""nearest corners that may be linked: the next line is among them even where corners of markers are nearer"""
TOLERANCE, TOLERANCE_SMALL, SMALL = np.deg2rad(20), np.deg2rad(27), 10.0
"""largest angle between a link and the axes at its ends; more for links under 10 px, whose axes are less accurate"""
LEAST_CONTRAST = 0.3
"""least contrast in every third of a link, share of the weaker corner's contrast"""
FEW, WIDE = 30_000, 0.2
"""up to so many corners, or from this share of the image on, all corners are tested one by one instead of through the
index"""
GONE = -1e6
"""coordinate assigned to peaks that turn out to be duplicates of other corners"""
UNEVEN = 2.5
"""ratio of a cell's opposite sides from which on it is no cell"""


@dataclass(frozen=True, eq=False)
class Field:
    """Corners as input of the board recovery: N corners; `strong` ones may start boards, the others only complete them.

    `xy` (N, 2); `axes` (N, 2) NaN if unknown; `polarity` (N,) ±1, 0; `contrast` (N,); `fit` (N,); `response` (N,);
    `strong`, `refined` (N,) bool. The last of them are `peaks`, of which only the response is known until `evaluate`
    evaluates them: `waiting` (N,) bool.
    """

    grey: Array
    xy: Array
    axes: Array
    polarity: Array
    contrast: Array
    fit: Array
    response: Array
    strong: Array
    refined: Array
    peaks: Peaks | None = None
    waiting: Array | None = None

    @cached_property
    def _cells(self) -> PointCells:
        """Spatial index of the initial positions; `evaluate` changes them slightly."""
        return PointCells(self.xy.copy())

    @cached_property
    def _moved(self) -> Real[Array, " 1"]:
        """(1,) px: largest displacement of a corner from its initial position."""
        return np.zeros(1)

    @cached_property
    def rounds(self) -> Int[Array, " 1"]:
        """(1,) int: number of rounds of growth of all grids so far."""
        return np.zeros(1, np.int64)

    def near(self, some: Bool[Array, " n"], spots: Real[Array, "k 2"], margin: float) -> Array:
        """Rows, in ascending order, of the corners `some` (N,) bool within `margin` px of the bounding box of `spots`
        (K, 2), K ≥ 1."""
        low, high = spots.min(axis=0) - margin, spots.max(axis=0) + margin
        if len(self.xy) <= FEW or self._cells.share(low, high) > WIDE:
            rows = np.empty(len(self.xy), np.int64)
            return rows[: _boxed(self.xy, some.view(np.uint8), *low.tolist(), *high.tolist(), rows)]
        rows = self._cells.inside(low - self._moved, high + self._moved)
        at = self.xy[rows]
        return rows[some[rows] & ((at >= low) & (at <= high)).all(axis=1)]

    def evaluate(self, spots: Real[Array, "k 2"], reach: Real[Array, " k"]) -> None:
        """Evaluate the waiting peaks within `reach` (K,) px of `spots` (K, 2), in place; duplicates of other corners
        are removed."""
        if self.peaks is None or self.waiting is None or not len(spots) or not len(self.peaks.xy):
            return
        first = len(self.xy) - len(self.peaks.xy)
        row = self.near(self.waiting, spots, float(np.max(reach)))
        row = row[np.unique(within(self.xy[row], spots, reach)[1])]
        if not len(row):
            return
        self.waiting[row] = False
        row = row[np.argsort(-self.response[row], kind="stable")]
        xy, status, seen = self.peaks.evaluate(row - first)
        known = ~self.waiting
        known[row] = False
        fresh = _apart(xy, self.xy[self.near(known, xy, SAME)])
        self._moved[0] = max(self._moved[0], np.abs(xy - self.xy[row]).max())
        self.xy[row[~fresh]] = GONE
        row = row[fresh]
        self.xy[row], self.refined[row] = xy[fresh], status[fresh] != Status.SEED
        self.axes[row], self.polarity[row] = seen.axes[fresh], seen.polarity[fresh]
        self.contrast[row], self.fit[row] = seen.contrast[fresh], seen.fit[fresh]

    @property
    def unevaluated(self) -> int:
        """Number of peaks not evaluated yet."""
        return 0 if self.waiting is None else int(np.count_nonzero(self.waiting))

    @property
    def quality(self) -> Real[Array, " n"]:
        """Response × fit (N,): evidence for an X-corner from the network and from the rings around it."""
        return self.response * self.fit

    def side_colour(self, index: Array, direction: Array) -> tuple[Array, Array]:
        """Colour (±1, bright or dark) at rising angle from `direction` at corners `index`, and the angle to the nearest
        axis, radians."""
        turn = np.abs((self.axes[index] - direction[..., None] + np.pi / 2) % np.pi - np.pi / 2)
        turn = np.where(np.isfinite(turn), turn, np.pi)
        axis = turn.argmin(axis=-1)
        return np.where(axis == 0, 1, -1) * self.polarity[index], turn.min(axis=-1)


def _apart(xy: Array, known: Real[Array, "n 2"]) -> Bool[Array, " k"]:
    """Which positions (K,), strongest first, are distinct: not within SAME px of one of `known` (N, 2) nor of a
    stronger one."""
    fresh = nearest(known, xy)[0][:, 0] >= SAME
    for one, other in pairs(xy, SAME).tolist():
        if fresh[one]:
            fresh[other] = False
    return np.asarray(fresh)


def links(field: Field) -> Int[Array, "n 4"]:
    """Mutual links (N, 4): the neighbour along the first axis, along the second, against the first and against the
    second, that is, by rising angle; −1 for none.

    A link lies along an axis at both of its ends, its ends have opposite polarity (SPEC: the neighbours of an X-corner
    are its negatives), and the edge between them is visible over its whole length. Each slot takes its shortest link;
    both ends must choose each other.
    """
    out = np.full((len(field.xy), 4), -1)
    usable = np.flatnonzero(field.strong & field.refined & (field.polarity != 0))
    if len(usable) < 4:
        return out
    xy, axes = field.xy[usable], field.axes[usable]
    features = np.empty((len(usable), 6))
    features[:, 0:4:2], features[:, 1:4:2] = cos_sin(axes)
    features[:, 4], features[:, 5] = field.polarity[usable], field.contrast[usable]
    distance, near = nearest(xy, xy, NEIGHBOURS + 1)
    own, room = np.empty((len(usable), 4), np.int64), np.empty((len(usable), 4), np.int64)
    strict, loose = cos_sin([TOLERANCE, TOLERANCE_SMALL])[1].tolist()
    limits = SMALL, strict, loose, LEAST_CONTRAST
    _links(field.grey, xy, features, near, distance, *limits, np.empty(own.shape), room, own)
    out[usable] = np.where(own >= 0, usable[own], -1)
    return out


def near_pairs(xy: Real[Array, "n 2"], usable: Real[Array, " k"], count: int) -> tuple[Array, Array, Array, Array]:
    """Pairs of each corner of `usable` (K,), rows of `xy` (N, 2), with its `count` nearest among them.

    Returns, each (M,): from, to, distance px, direction rad.
    """
    distance, near = nearest(xy[usable], xy[usable], count + 1)
    row, rank = np.nonzero((near != np.arange(len(usable))[:, None]) & (near < len(usable)))
    i, j = usable[row], usable[near[row, rank]]
    step = xy[j] - xy[i]
    return i, j, distance[row, rank], arctan2(step[:, 1], step[:, 0])


def slot_of(axes: Real[Array, "m k"], angle: Real[Array, " m"]) -> Array:
    """Which of the 2 K directions of `axes` (M, K) is nearest to `angle` (M,): axis k is slot k, its opposite direction
    K + k."""
    turn = cos_sin(angle[:, None] - axes)[0]
    axis = np.abs(turn).argmax(axis=1)
    return np.asarray(axis + axes.shape[1] * (turn[np.arange(len(axes)), axis] < 0))


def mutual(out: Real[Array, "n s"], i: Array, j: Array, length: Array, slot: Array) -> Array:
    """`out` (N, S), −1 for none, with the shortest link i → j of each slot, kept only where both ends choose each
    other."""
    i, j, slot = (np.ascontiguousarray(a, np.int64) for a in (i, j, slot))
    _mutual(i, j, length, slot, np.empty(out.shape), np.empty_like(out), out)
    return out


def cells(field: Field, neighbour: Array) -> Int[Array, "q 4"]:
    """Quadrilaterals (Q, 4) of links, corners a, b, c, d clockwise on the screen, each once, convex and not extremely
    skewed."""
    return linked_cells(field.xy, neighbour, CHECKER, UNEVEN)


def linked_cells(xy: Real[Array, "n 2"], neighbour: Int[Array, "n s"], rule: Rule, ratio: float) -> Int[Array, "q c"]:
    """Cells (Q, `rule.sides`) of mutual links `neighbour` (N, S), clockwise on the screen, each once.

    None of a cell's sides, of a square's opposite ones, is `ratio` times as long as another.
    """
    room = 4 * int(np.count_nonzero(neighbour >= 0))
    out = np.empty((room, rule.sides), np.int64)
    held = np.empty(len(neighbour), np.int64), np.empty(room, np.int64)
    return out[: _cells(neighbour, np.ascontiguousarray(xy, np.float64), ratio, *held, out)]


def label(field: Field, quads: Array) -> list[dict[Label, int]]:
    """Grids by flood fill over cells (Q, 4), each {(u, v): corner}, starting from the cell of highest response.

    A cell that contradicts its grid is left out.
    """
    return [at for at, _ in flood(field.response, quads, np.zeros(len(quads), np.int64), CHECKER)]


def flood(
    response: Real[Array, " n"], found: Int[Array, "q c"], colour: Int[Array, " q"], rule: Rule
) -> list[tuple[dict[Label, int], int]]:
    """Lattices by flood fill over cells `found` (Q, `rule.sides`) of `colour` (Q,) ±1, 0 for squares, the cell of
    highest response first.

    Returns {(u, v): corner} and the colour of the cell at (0, 0) for each. A cell that contradicts is left out.
    """
    count, corners = len(found), len(response)
    if not count:
        return []
    order = np.argsort(-response[found].min(axis=1), kind="stable")
    size, steps = rule.sides * count, np.array(rule.steps, np.int64)
    slots = 1 << size.bit_length()
    heap, first, at_corner, where, held, begin, out = (
        np.empty(shape, np.int64)
        for shape in (size + 1, corners + 2, size, (corners, 3), (slots, 4), (count + 1, 2), (size, 3))
    )
    given = found[order], colour[order], order, steps
    many = _label(*given, np.empty(count, np.uint8), heap, first, at_corner, where, held, begin, out)
    ends = pairwise(begin[: many + 1].tolist())
    return [({(u, v): corner for u, v, corner in out[a:b].tolist()}, own) for (a, own), (b, _) in ends]
