"""Triangles of a deltille: links between six-sector corners, cells of three corners, and labels by flood fill.

Labels (u, v) count edges along two sides of a triangle, 60° apart; half of the triangles, those between (u, v),
(u + 1, v) and (u, v + 1), have one colour. All tests are local, as in the graph of squares (`boards.graph`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.boards.convert import as_field
from rcdn.boards.edges import sample_grey
from rcdn.boards.graph import Field, flood, linked_cells, mutual, near_pairs, slot_of
from rcdn.corners import Candidates
from rcdn.geometry.elementary import cos_sin
from rcdn.geometry.rules import TRIANGLES, Label
from rcdn.types import Array
from rcdn.types.arrays import Int, Real

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


def as_six_sided(grey: Array, candidates: Candidates) -> Field:
    """Six-sector corners as input of the recovery: `Field.axes` is (N, 3), and those that may not join a lattice have
    polarity 0."""
    field = as_field(grey, candidates)
    return replace(field, polarity=np.where(field.refined & (field.fit >= FIT), field.polarity, 0))


def side(field: Field, index: Array, direction: Array) -> tuple[Array, Array]:
    """Colour (±1) at corners `index` of the sector at rising angle from the axis nearest to `direction`, and the
    angle to that axis, as a share of the angle from it to the next."""
    axes = field.axes[index]
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
    colour = field.polarity[index] * np.where(axis == 1, -1, 1) * np.where(half, -1, 1)
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
    (one, turn), (other, back) = side(field, i, angle), side(field, j, angle)
    ratio = field.contrast[i] / np.maximum(field.contrast[j], 1e-9)
    fine = (one == other) & (turn < TURN) & (back < TURN) & (ratio < UNLIKE) & (ratio > 1 / UNLIKE)
    i, j, length, angle = i[fine], j[fine], length[fine], angle[fine]
    return mutual(out, i, j, length, slot_of(field.axes[i], angle))


def cells(field: Field, neighbour: Array) -> tuple[Int[Array, "t 3"], Int[Array, " t"]]:
    """Triangles (T, 3) of links, clockwise on the screen, each once, and their colours in the image (T,), ±1."""
    found = linked_cells(field.xy, neighbour, TRIANGLES, 2 * UNLIKE)
    found = found[np.lexsort(found.T[::-1])]
    shown = triangle_contrast(field.grey, field.xy[found])
    colour = np.sign(shown.sum(axis=1)).astype(np.int64)
    fine = (shown * colour[:, None]).min(axis=1, initial=np.inf) > SHOWN * field.contrast[found].min(
        axis=1, initial=np.inf
    )
    return found[fine], colour[fine]


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


def label(field: Field, found: tuple[Int[Array, "t 3"], Int[Array, " t"]]) -> list[tuple[dict[Label, int], int]]:
    """Lattices by flood fill over cells of alternating colours, the largest first.

    Returns {(u, v): corner} and the colour of the triangle at (0, 0) for each.
    """
    grids = flood(field.response, *found, TRIANGLES)
    return sorted(grids, key=lambda g: (-len(g[0]), min(g[0].values())))
