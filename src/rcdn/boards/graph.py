"""The validated link graph: which corner neighbours which, and the cells that four of them make.

Purely local: no line, no homography, no size; so distorted, bent, cut and several boards come for free.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards.edges import edge_contrast
from rcdn.corners.peaks import SAME, Peaks
from rcdn.types import Array, Status

NEIGHBOURS = 14
TOLERANCE, TOLERANCE_SMALL, SMALL = np.deg2rad(20), np.deg2rad(27), 10.0
"""how far a link may turn from the axes at its ends; more for links under 10 px, whose axes are less sure"""
LEAST_CONTRAST = 0.3
"""every third of a link shows this share of the weaker corner's contrast"""
GONE = -1e6
"""where corners are put that turned out to be others"""
SLOTS = ((0, 1), (1, 1), (0, -1), (1, -1))
"""(axis, sign) of the four links of a corner, by rising angle"""

Label = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Field:
    """Corners as the recovery sees them: N corners; `strong` ones may start boards, the others only complete them.

    `xy` (N, 2); `axes` (N, 2) NaN if unknown; `polarity` (N,) ±1, 0; `contrast` (N,); `fit` (N,); `response` (N,); `strong`, `refined` (N,) bool.
    The last of them are `peaks`, of which nothing but the response is known before `look` is called for: `waiting` (N,) bool.
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

    def look(self, spots: Array, reach: Array) -> None:
        """Learn what the waiting peaks within `reach` (K,) px of `spots` (K, 2) are. In place; those that turn out to be another corner go."""
        if self.peaks is None or self.waiting is None or not len(spots) or not len(self.peaks.xy):
            return
        first = len(self.xy) - len(self.peaks.xy)
        found = np.concatenate(self.peaks.tree.query_ball_point(spots, reach)).astype(int)
        row = np.unique(first + found)
        row = row[self.waiting[row]]
        if not len(row):
            return
        self.waiting[row] = False
        row = row[np.argsort(-self.response[row], kind="stable")]
        xy, status, seen = self.peaks.look(row - first)
        known = ~self.waiting
        known[row] = False
        fresh = _apart(xy, self.xy[known])
        self.xy[row[~fresh]] = GONE
        row = row[fresh]
        self.xy[row], self.refined[row] = xy[fresh], status[fresh] != Status.SEED
        self.axes[row], self.polarity[row] = seen.axes[fresh], seen.polarity[fresh]
        self.contrast[row], self.fit[row] = seen.contrast[fresh], seen.fit[fresh]

    @property
    def quality(self) -> Array:
        """Response × fit (N,): how much each corner is an X-corner, by the network and by the rings around it."""
        return self.response * self.fit

    def side_colour(self, index: Array, direction: Array) -> tuple[Array, Array]:
        """Colour (±1, bright or dark) at rising angle from `direction` at corners `index`, and the turn from the nearest axis, radians."""
        turn = np.abs((self.axes[index] - direction[..., None] + np.pi / 2) % np.pi - np.pi / 2)
        turn = np.where(np.isfinite(turn), turn, np.pi)
        axis = turn.argmin(axis=-1)
        return np.where(axis == 0, 1, -1) * self.polarity[index], turn.min(axis=-1)


def _apart(xy: Array, known: Array) -> Array:
    """Which positions (K,), strongest first, are corners of their own: not on one of `known` (N, 2) nor on a stronger one."""
    fresh = np.ones(len(xy), bool)
    if len(known):
        fresh = cKDTree(known).query(xy)[0] >= SAME
    for one, other in sorted(cKDTree(xy).query_pairs(SAME)):
        if fresh[one]:
            fresh[other] = False
    return np.asarray(fresh)


def links(field: Field) -> Array:
    """Mutual links (N, 4): the neighbour in each slot (SLOTS), −1 for none.

    A link lies along an axis at both of its ends, its ends have opposite polarity (SPEC: an X-corner's neighbours are its negatives), and
    the edge between them is seen in the picture over its whole length. Each slot takes its shortest link; both ends must choose each other.
    """
    count = len(field.xy)
    out = np.full((count, 4), -1)
    usable = np.flatnonzero(field.strong & field.refined & (field.polarity != 0))
    if len(usable) < 4:
        return out
    i, j, length, angle = near_pairs(field.xy, usable, NEIGHBOURS)
    (colour_i, turn_i), (colour_j, turn_j) = field.side_colour(i, angle), field.side_colour(j, angle)
    limit = np.where(length < SMALL, TOLERANCE_SMALL, TOLERANCE)
    fine = (turn_i < limit) & (turn_j < limit) & (colour_i == -colour_j)
    i, j, length, angle, colour = i[fine], j[fine], length[fine], angle[fine], colour_i[fine]
    shown = edge_contrast(field.grey, field.xy[i], field.xy[j]) * colour[:, None]
    fine = shown.min(axis=1) > LEAST_CONTRAST * np.minimum(field.contrast[i], field.contrast[j])
    i, j, length, angle = i[fine], j[fine], length[fine], angle[fine]
    return mutual(out, i, j, length, slot_of(field.axes[i], angle))


def near_pairs(xy: Array, usable: Array, count: int) -> tuple[Array, Array, Array, Array]:
    """Each corner of `usable` (K,), numbers of rows of `xy` (N, 2), and its `count` nearest among them: from, to, distance px, direction (M,) rad."""
    own = xy[usable]
    distance, near = cKDTree(own).query(own, k=min(count + 1, len(usable)))
    i, j = np.repeat(usable, near.shape[1] - 1), usable[near[:, 1:].ravel()]
    step = xy[j] - xy[i]
    return i, j, distance[:, 1:].ravel(), np.arctan2(step[:, 1], step[:, 0])


def slot_of(axes: Array, angle: Array) -> Array:
    """Which of the 2 K directions of `axes` (M, K) the direction `angle` (M,) is nearest to: axis k is slot k, its other end K + k."""
    turn = np.cos(angle[:, None] - axes)
    axis = np.abs(turn).argmax(axis=1)
    return np.asarray(axis + axes.shape[1] * (turn[np.arange(len(axes)), axis] < 0))


def mutual(out: Array, i: Array, j: Array, length: Array, slot: Array) -> Array:
    """`out` (N, S), all −1, with the shortest link i → j of each slot, where the other end has chosen its corner, too."""
    order = np.lexsort((j, -length))  # the shortest is written last, and stays
    out[i[order], slot[order]] = j[order]
    back = np.zeros_like(out, bool)
    for k in range(out.shape[1]):
        has = np.flatnonzero(out[:, k] >= 0)
        back[has, k] = (out[out[has, k]] == has[:, None]).any(axis=1)
    return np.where(back, out, -1)


def cells(field: Field, neighbour: Array) -> list[tuple[int, int, int, int]]:
    """Quadrilaterals (a, b, c, d) of links, turning clockwise on the screen, each once, convex and not absurdly skewed."""
    found: dict[frozenset[int], tuple[int, int, int, int]] = {}
    linked = np.flatnonzero((neighbour >= 0).any(axis=1))
    rows = dict(zip(linked.tolist(), neighbour[linked].tolist(), strict=True))
    sets = {a: {n for n in row if n >= 0} for a, row in rows.items()}
    tries = []
    for a, row in rows.items():
        for k in range(4):
            b, d = row[k], row[(k + 1) % 4]
            if b >= 0 and d >= 0:
                tries += [(a, b, c, d) for c in (sets[b] & sets[d]) - {a}]
    regular = _regular(field.xy[np.array(tries, int).reshape(-1, 4)])
    for quad, fine in zip(tries, regular.tolist(), strict=True):
        if fine:
            found.setdefault(frozenset(quad), quad)
    return list(found.values())


def _regular(quads: Array) -> Array:
    """(K,) bool of quads (K, 4, 2)."""
    edge = np.roll(quads, -1, axis=1) - quads
    after = np.roll(edge, -1, axis=1)
    turn = edge[..., 0] * after[..., 1] - edge[..., 1] * after[..., 0]
    length = np.hypot(edge[..., 0], edge[..., 1])
    ratio = np.maximum(length[:, :2], length[:, 2:]) / np.maximum(np.minimum(length[:, :2], length[:, 2:]), 1e-9)
    return np.asarray((turn > 0).all(axis=1) & (ratio < 2.5).all(axis=1))


def label(field: Field, quads: list[tuple[int, int, int, int]]) -> list[dict[Label, int]]:
    """Grids by flood fill over cells, each {(u, v): corner}; the surest cell first; a cell that contradicts its grid is left out."""
    score = [float(field.response[list(q)].min()) for q in quads]
    at_edge: dict[frozenset[int], list[int]] = {}
    for index, quad in enumerate(quads):
        for k in range(4):
            at_edge.setdefault(frozenset((quad[k], quad[(k + 1) % 4])), []).append(index)
    used, grids = [False] * len(quads), []
    for seed in sorted(range(len(quads)), key=lambda q: (-score[q], q)):
        if used[seed]:
            continue
        grid: dict[Label, int] = {}
        where: dict[int, Label] = {}
        heap: list[tuple[float, int]] = []
        _place(grid, where, quads[seed], ((0, 0), (1, 0), (1, 1), (0, 1)))
        used[seed] = True
        _push(heap, at_edge, used, quads[seed], score)
        while heap:
            index = heapq.heappop(heap)[1]
            if used[index]:
                continue
            used[index] = True
            spots = _spots(where, quads[index])
            if spots and _agrees(grid, where, quads[index], spots):
                _place(grid, where, quads[index], spots)
                _push(heap, at_edge, used, quads[index], score)
        grids.append(grid)
    return grids


def _push(
    heap: list[tuple[float, int]],
    at_edge: dict[frozenset[int], list[int]],
    used: list[bool],
    quad: tuple[int, ...],
    score: list[float],
) -> None:
    for k in range(4):
        for other in at_edge[frozenset((quad[k], quad[(k + 1) % 4]))]:
            if not used[other]:
                heapq.heappush(heap, (-score[other], other))


def _spots(where: dict[int, Label], quad: tuple[int, ...]) -> tuple[Label, ...] | None:
    """Labels of a cell's corners from two of them that are known; all cells turn the same way, so that two are enough."""
    for k in range(4):
        a, b = quad[k], quad[(k + 1) % 4]
        if a in where and b in where:
            (u, v), (p, q) = where[a], where[b]
            du, dv = p - u, q - v
            if abs(du) + abs(dv) != 1:
                return None
            out = [(u, v), (p, q), (p - dv, q + du), (u - dv, v + du)]
            return tuple(out[(n - k) % 4] for n in range(4))
    return None


def _agrees(grid: dict[Label, int], where: dict[int, Label], quad: tuple[int, ...], spots: tuple[Label, ...]) -> bool:
    return all(grid.get(s, c) == c and where.get(c, s) == s for c, s in zip(quad, spots, strict=True))


def _place(grid: dict[Label, int], where: dict[int, Label], quad: tuple[int, ...], spots: tuple[Label, ...]) -> None:
    for corner, spot in zip(quad, spots, strict=True):
        grid[spot], where[corner] = corner, spot
