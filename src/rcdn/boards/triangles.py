"""Triangles of a deltille: links between six-sector corners, cells of three corners, and labels by flood fill.

Labels (u, v) count edges along two sides of a triangle, 60° apart; half of the triangles, those between (u, v),
(u + 1, v) and (u, v + 1), have one colour. All tests are local, as in the graph of squares (`boards.graph`).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from rcdn.boards.edges import sample_grey
from rcdn.boards.graph import Label, mutual, near_pairs, slot_of
from rcdn.corners import Candidates
from rcdn.geometry.elementary import cos_sin
from rcdn.types import Array, Status
from rcdn.types.arrays import Bool, Real

STEPS = np.array([[1, 0], [0, 1], [-1, 1], [-1, 0], [0, -1], [1, -1]])
"""steps from a corner to its neighbours, by rising angle"""
NEIGHBOURS = 10
"""nearest corners that may be linked"""
TURN = 0.4
"""largest angle between a link and the axes at its ends, share of the angle to the next axis"""
UNLIKE = 2.5
"""largest ratio of the contrasts of two linked corners, and, doubled, of the sides of a triangle"""
SHOWN = 0.3
"""least contrast across each side of a triangle, share of the weakest of its corners' contrasts"""
FIT = 0.5
"""least `fit` of a corner that may start a lattice or join one"""

Triangle = tuple[int, int, int]


@dataclass(eq=False)
class Field:
    """Six-sector corners: `xy` (N, 2), `axes` (N, 3), `polarity`, `contrast`, `fit`, `response` (N,), `strong` (N,)
    bool.

    Corners found by searching the image are appended to `xy`; the first `known` come from the network.
    """

    grey: Array
    xy: Array
    axes: Array
    polarity: Array
    contrast: Array
    fit: Array
    response: Array
    strong: Array
    known: int

    @classmethod
    def of(cls, grey: Array, candidates: Candidates) -> Field:
        seen, found = candidates.orientation, candidates.all
        refined = found.status != Status.SEED
        polarity = np.where(refined & (seen.fit >= FIT), seen.polarity, 0).astype(int)
        return cls(
            grey, found.xy, seen.axes, polarity, seen.contrast, seen.fit, found.response, candidates.seed, len(found)
        )

    def append(self, xy: Array) -> int:
        """Append a corner without a network response, already verified in the image; returns its index."""
        self.xy = np.vstack([self.xy, xy])
        return len(self.xy) - 1

    def side(self, index: Array, direction: Array) -> tuple[Array, Array]:
        """Colour (±1) at corners `index` of the sector at rising angle from the axis nearest to `direction`, and the
        angle to that axis, as a share of the angle from it to the next."""
        axes = self.axes[index]
        turn = (direction[:, None] - axes + np.pi / 2) % np.pi - np.pi / 2
        turn = np.where(np.isfinite(turn), turn, np.pi)
        row, axis = np.arange(len(index)), np.abs(turn).argmin(axis=1)
        closest = turn[row, axis]
        after, before = (
            (axes[row, (axis + 1) % 3] - axes[row, axis]) % np.pi,
            (axes[row, axis] - axes[row, axis - 1]) % np.pi,
        )
        room = np.where(closest >= 0, after, before)
        # the sectors after the axes have colours p, −p, p; opposite sectors have the opposite colours
        half = cos_sin(direction - axes[row, axis])[0] < 0
        colour = self.polarity[index] * np.where(axis == 1, -1, 1) * np.where(half, -1, 1)
        return colour, np.abs(closest) / np.maximum(np.nan_to_num(room, nan=1e-9), 1e-9)


def links(field: Field) -> Real[Array, "n 6"]:
    """Mutual links (N, 6): the neighbour in each of six slots, by rising angle from the first axis, −1 for none.

    A link lies along an axis at both of its ends, and the sector at its side has the same colour at both.
    """
    out = np.full((len(field.xy), 6), -1)
    usable = np.flatnonzero(field.strong & (field.polarity != 0))
    if len(usable) < 3:
        return out
    i, j, length, angle = near_pairs(field.xy, usable, NEIGHBOURS)
    (one, turn), (other, back) = field.side(i, angle), field.side(j, angle)
    ratio = field.contrast[i] / np.maximum(field.contrast[j], 1e-9)
    fine = (one == other) & (turn < TURN) & (back < TURN) & (ratio < UNLIKE) & (ratio > 1 / UNLIKE)
    i, j, length, angle = i[fine], j[fine], length[fine], angle[fine]
    return mutual(out, i, j, length, slot_of(field.axes[i], angle))


def cells(field: Field, neighbour: Array) -> list[tuple[Triangle, int]]:
    """Triangles (a, b, c) of links, clockwise on the screen, each once, and their colours in the image, ±1."""
    tries: set[Triangle] = set()
    for a in np.flatnonzero((neighbour >= 0).any(axis=1)).tolist():
        row = neighbour[a]
        for k in range(6):
            b, c = int(row[k]), int(row[(k + 1) % 6])
            if b >= 0 and c >= 0 and c in neighbour[b]:
                low = min(range(3), key=lambda n: (a, b, c)[n])
                tries.add(((a, b, c) * 2)[low : low + 3])  # type: ignore[arg-type]
    corners = np.array(sorted(tries), int).reshape(-1, 3)
    shown = triangle_contrast(field.grey, field.xy[corners])
    colour = np.sign(shown.sum(axis=1)).astype(int)
    weakest = field.contrast[corners].min(axis=1, initial=np.inf)
    fine = (shown * colour[:, None]).min(axis=1, initial=np.inf) > SHOWN * weakest
    fine &= _regular(field.xy[corners])
    return [((int(a), int(b), int(c)), int(s)) for (a, b, c), s in zip(corners[fine], colour[fine], strict=True)]


def _regular(corners: Array) -> Bool[Array, " t"]:
    """(T,) bool of triangles (T, 3, 2): clockwise, and not extremely elongated."""
    edge = np.roll(corners, -1, axis=1) - corners
    turn = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    length = np.linalg.norm(edge, axis=-1)
    return np.asarray((turn > 0) & (length.max(axis=1, initial=0) < 2 * UNLIKE * length.min(axis=1, initial=np.inf)))


INSIDE, ALONG = 0.2, np.linspace(0.3, 0.7, 5)
"""distance from a side, and positions along it, at which the image is sampled, shares of the triangle's height and
side"""


def triangle_contrast(grey: Array, corners: Array) -> Array:
    """Difference between the inside of triangles (T, 3, 2) px and the outside across each side, (T, 3) grey levels;
    positive: the inside is brighter."""
    if not len(corners):
        return np.zeros((0, 3))
    start, end, tip = corners, np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)
    on = start[:, :, None] + ALONG[:, None] * (end - start)[:, :, None]
    inwards = INSIDE * (tip - (start + end) / 2)[:, :, None]
    return np.asarray((sample_grey(grey, on + inwards) - sample_grey(grey, on - inwards)).mean(axis=2))


def label(field: Field, found: list[tuple[Triangle, int]]) -> list[tuple[dict[Label, int], int]]:
    """Lattices by flood fill over cells of alternating colours, the cell of highest response first.

    Returns {(u, v): corner} and the colour of the triangle at (0, 0) for each.
    """
    score = [float(field.response[list(t)].min()) for t, _ in found]
    at_edge: dict[tuple[int, int], int] = {
        (t[k], t[(k + 1) % 3]): n for n, (t, _) in enumerate(found) for k in range(3)
    }
    used, grids = [False] * len(found), []
    for seed in sorted(range(len(found)), key=lambda n: (-score[n], n)):
        if used[seed]:
            continue
        at: dict[Label, int] = {}
        where: dict[int, Label] = {}
        sign = found[seed][1]
        heap = [(-score[seed], seed)]
        while heap:
            n = heapq.heappop(heap)[1]
            if used[n]:
                continue
            triangle, colour = found[n]
            spots = _spots(where, triangle) if at else ((0, 0), (1, 0), (0, 1))
            if spots is None or colour != sign * _kind(spots):
                continue
            if any(at.get(s, c) != c or where.get(c, s) != s for c, s in zip(triangle, spots, strict=True)):
                continue
            used[n] = True
            for corner, spot in zip(triangle, spots, strict=True):
                at[spot], where[corner] = corner, spot
            for k in range(3):
                other = at_edge.get((triangle[(k + 1) % 3], triangle[k]))
                if other is not None and not used[other]:
                    heapq.heappush(heap, (-score[other], other))
        grids.append((at, sign))
    return sorted(grids, key=lambda g: (-len(g[0]), min(g[0].values())))


def _spots(where: dict[int, Label], triangle: Triangle) -> tuple[Label, Label, Label] | None:
    """Labels of a triangle's corners from two known ones: a rotation by 60° takes one side to the next but one."""
    for k in range(3):
        a, b = triangle[k], triangle[(k + 1) % 3]
        if a in where and b in where:
            (u, v), (p, q) = where[a], where[b]
            du, dv = p - u, q - v
            if (du, dv) not in _UNIT:
                return None
            out = [(u, v), (p, q), (u - dv, v + du + dv)]
            return out[-k % 3], out[(1 - k) % 3], out[(2 - k) % 3]
    return None


_UNIT = {(int(u), int(v)) for u, v in STEPS}


def _kind(spots: tuple[Label, ...]) -> int:
    """+1 for triangles like (0, 0), (1, 0), (0, 1), −1 for the others."""
    du, dv = spots[1][0] - spots[0][0], spots[1][1] - spots[0][1]
    return 1 if (du, dv) in ((1, 0), (-1, 1), (0, -1)) else -1
