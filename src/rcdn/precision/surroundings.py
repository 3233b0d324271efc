"""What is printed besides the crossing edges of a board's corners: markers, circles, bits of tags.

It is known from the decoded target, and part of the fit's model: shapes that are constant between edges parallel to the
board's axes, each edge blurred like those of the squares. Round shapes are approximated by strips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.native import constants
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

_C = constants("fit")
EDGES, CELLS, PARTS, SIDES = (_C[name] for name in ("EDGES", "CELLS", "PARTS", "SIDES"))
"""largest number of edges of a shape along an axis, and of cells between them; largest number of shapes around a
corner; sides of a corner"""

FEW = 16
"""least number of corners from which the distances on the board can be estimated"""
STEP = 1e-4
"""step of a numerical derivative, squares"""

Shape = tuple[Array, Array]


class Print(NamedTuple):
    """What is printed, as an argument of kernels: see src/native/fit_print.h."""

    edge: Array
    value: Array
    which: Array
    at: Array
    sign: Array
    next: Array


PLAIN = Print(
    np.zeros((0, 2, EDGES)), np.zeros((0, CELLS, CELLS)), np.zeros((0, PARTS), np.int32), np.zeros((0, PARTS, 2)),
    np.zeros(0), np.zeros((0, SIDES))
)  # fmt: skip
"""a plain checkerboard: only squares"""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is printed around each of N corners.

    `drawn`: the shapes, for kernels; of several alternatives the one that fits the picture best is used. `ends`
    (N, SIDES): distance towards −u, +u, −v, +v up to which the print is known, squares. `plane` (N, 2): the corners'
    positions on the board, squares; `by_gap` (N, 2): their derivative with respect to a distance on the board that
    isn't known exactly.
    """

    drawn: tuple[Print, ...]
    ends: Array
    plane: Array
    by_gap: Array | None = None

    def plane_of(self, xy: Real[Array, "n 2"]) -> Real[Array, "n 2"]:
        """The positions (N, 2) on the board that fit corners at `xy` (N, 2) px best: the unknown distance is estimated
        by least squares together with a homography and a cubic for perspective and lens."""
        if self.by_gap is None or len(xy) < FEW:
            return self.plane
        x, y = (2 * (self.plane - self.plane.min(axis=0)) / np.ptp(self.plane, axis=0) - 1).T
        bent = np.stack([x**a * y**b for a in range(4) for b in range(4 - a)], axis=1)
        H = homography(self.plane, xy)
        base, ahead = (apply_homography(H, self.plane + step * self.by_gap) for step in (0.0, STEP))
        moved = (ahead - base) / STEP
        off = xy - base
        along, down = (np.linalg.lstsq(bent, np.stack([moved[:, k], off[:, k]], axis=1), rcond=None)[0] for k in (0, 1))
        left = np.stack([np.stack([moved[:, k], off[:, k]], axis=1) - bent @ fit for k, fit in ((0, along), (1, down))])
        change = (left[..., 0] * left[..., 1]).sum() / (left[..., 0] ** 2).sum()
        return np.asarray(self.plane + change * self.by_gap)


def without_shapes(known: Print) -> Print:
    """The edges without the shapes."""
    return known._replace(which=np.full_like(known.which, -1))


def drawn(
    shapes: Sequence[Shape], which: Array, at: Array, bright: Bool[Array, " n"], following: Array | None = None
) -> Print:
    """Shapes for kernels.

    `which` (N, PARTS): the shapes around a corner, −1 for none, with their centres `at` (N, PARTS, 2) squares from it.
    `bright` (N,) bool: the quadrants where u · v > 0 are bright. `following` (N, SIDES): distance to the next edges
    towards −u, +u, −v, +v, squares; None: 1.
    """
    edge = np.array([s[0] for s in shapes]).reshape(-1, 2, EDGES)
    value = np.array([s[1] for s in shapes]).reshape(-1, CELLS, CELLS)
    which, at = np.ascontiguousarray(which, np.int32), np.ascontiguousarray(at, float)
    following = np.ones((len(which), SIDES)) if following is None else np.ascontiguousarray(following, float)
    return Print(edge, value, which, at, np.where(bright, 1.0, -1.0), following)


def shape(u: Array, v: Array, values: Real[Array, "a b"]) -> Shape:
    """Edges (2, EDGES) and values (CELLS, CELLS) of a shape with `values` (A, B) between the edges `u` (A + 1,) and `v`
    (B + 1,), rising, squares from its centre; 0 outside. Values are in units of the contrast: −2 is black on white.
    """
    cells = np.pad(np.asarray(values, float), 1)
    edge, out = np.full((2, EDGES), np.inf), np.zeros((CELLS, CELLS))
    for k, at in enumerate((u, v)):  # drops edges at which no value changes
        keep = np.diff(cells, axis=k).any(axis=1 - k)
        edge[k, : keep.sum()] = np.asarray(at)[keep]
        cells = cells.compress(np.append(True, keep), axis=k)
    out[: cells.shape[0], : cells.shape[1]] = cells
    return edge, out
