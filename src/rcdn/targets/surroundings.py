"""What is printed around each corner of a coded target, for the final fit."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rcdn.precision.surroundings import PARTS, SIDES, Shape, Surroundings, drawn, shape, without_shapes
from rcdn.targets.dictionaries import marker_bits, tag_bits
from rcdn.targets.layout import QUADRANTS, markers_in
from rcdn.targets.placement import Placement, placement
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.types import AprilGrid, Array, Board, Charuco, PuzzleBoard
from rcdn.types.arrays import Shaped

RADIUS = 1 / 6
"""radius of a PuzzleBoard's circles, squares"""
STRIPS = 5
"""number of strips of equal width that approximate half a circle"""
UNKNOWN = 0.25
"""length of the known part of an edge whose other end wasn't detected, squares: it may have a circle or not"""
STEPS = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])
"""offsets to the next corners"""


def surroundings(grey: Shaped[Array, "h w"], board: Board) -> Surroundings | None:
    """What is printed around the corners of a decoded board in the picture `grey` (H, W); None if that is only squares,
    or not known."""
    if isinstance(board.target, Charuco):
        placed = placement(grey, board, board.target)
        return None if placed is None else _charuco(board.target, board.ij, placed)
    if isinstance(board.target, PuzzleBoard):
        return _puzzle(board.ij)
    if isinstance(board.target, AprilGrid):
        return _aprilgrid(board.target, board.ij)
    return None


def _charuco(target: Charuco, ij: Array, placed: Placement) -> Surroundings | None:
    square = ij[:, None] + QUADRANTS  # (N, 4, 2) column and row
    marker, marked = markers_in(target, square)
    known, shapes = np.unique(marker[marked], return_inverse=True)
    if known[0] < 0 or known[-1] >= len(marker_bits(target.dictionary)):
        return None
    which = np.full(marker.shape, -1)
    which[marked] = shapes
    markers = [_marker(target.dictionary, k, placed.side, target.inverted) for k in known.tolist()]
    at = QUADRANTS - 0.5 + placed.shift(square[..., 0], square[..., 1])
    print_ = drawn(markers, which, at, marked[:, 3] != target.inverted)
    return Surroundings((print_, without_shapes(print_)), np.full((len(ij), SIDES), 0.5), ij.astype(float))


@lru_cache(4096)
def _marker(dictionary: str, number: int, side: float, inverted: bool) -> Shape:
    """A marker with its border of one bit."""
    dark = np.pad(marker_bits(dictionary)[number], 1).T == 0
    edges = side * np.linspace(-0.5, 0.5, len(dark) + 1)
    return shape(edges, edges, np.where(dark, 2.0 if inverted else -2.0, 0.0))


def _puzzle(ij: Array) -> Surroundings:
    bright = ij.sum(axis=1) % 2 == 1
    places = {place: k for k, place in enumerate(map(tuple, ij.tolist()))}
    ends, which = np.full((len(ij), SIDES), UNKNOWN), np.full((len(ij), PARTS), -1)
    for side, step in enumerate(STEPS):
        known = np.array([place in places for place in map(tuple, (ij + step).tolist())])
        first = np.minimum(ij, ij + step)
        code, row, column = (CODE_2, first[:, 0], first[:, 1]) if step[0] else (CODE_1, first[:, 1], first[:, 0])
        bits = np.array([[bit == "1" for bit in line] for line in code])
        white = bits[row % 3, column % 167]
        # beyond the corner, the half of the circle towards positive v (or u) lies on white if the quadrant there is
        # white; a circle is visible in the half whose square has the other colour
        upper = (bright == (side % 2 == 1)) != white
        ends[known, side] = 0.5
        which[:, side] = np.where(known, 4 * (step[0] == 0) + 2 * upper + white, -1)
    shapes = [_half_disc(*kind) for kind in np.ndindex(2, 2, 2)]
    at = np.broadcast_to(STEPS / 2, (len(ij), PARTS, 2))
    print_ = drawn(shapes, which, at, bright)
    return Surroundings((print_, without_shapes(print_)), ends, ij.astype(float))


@lru_cache
def _half_disc(down: int, upper: int, white: int) -> Shape:
    """Half a circle on an edge along u (or, if `down`, along v), the half towards positive v (or u) if `upper`; `white`
    on black or black on white."""
    cut = RADIUS * np.sin(np.linspace(0, np.pi / 2, STRIPS + 1))
    area = (cut * np.sqrt(np.maximum(RADIUS**2 - cut**2, 0)) + RADIUS**2 * np.arcsin(np.minimum(cut / RADIUS, 1))) / 2
    half = np.diff(area) / np.diff(cut)  # half lengths of the strips, falling
    along = np.concatenate([-half, half[::-1]])
    middle = (along[1:] + along[:-1]) / 2
    values = np.where(np.abs(middle)[:, None] < half, 2.0 if white else -2.0, 0.0)
    if not upper:
        cut, values = -cut[::-1], values[:, ::-1]
    return shape(cut, along, values.T) if down else shape(along, cut, values)


def _aprilgrid(target: AprilGrid, ij: Array) -> Surroundings | None:
    bits = tag_bits(target.family)
    column, row = (ij // 2).T
    tag = target.first_id + row * target.columns + target.columns - 1 - column
    known, which = np.unique(tag, return_inverse=True)
    if known[0] < 0 or known[-1] >= len(bits):
        return None
    begins = ij % 2 == 0  # the corner's tag lies towards positive u, v
    following = np.where(np.repeat(begins, 2, axis=1), np.tile([target.gap, 1.0], 2), np.tile([1.0, target.gap], 2))
    at = np.zeros((len(ij), PARTS, 2))
    at[:, 0] = np.where(begins, 0.5, -0.5)
    own = np.column_stack([which, np.full((len(ij), PARTS - 1), -1)])
    prints = [
        drawn(
            [_tag(target.family, k, border) for k in known.tolist()], own, at, begins[:, 0] != begins[:, 1], following
        )
        for border in (target.border, *sorted({1, 2} - {target.border}))  # the code can be decoded with either
    ]
    return Surroundings((*prints, without_shapes(prints[0])), following / 2, target.plane(ij), (ij // 2).astype(float))


@lru_cache(4096)
def _tag(family: str, number: int, border: int) -> Shape:
    """The white bits of a tag, whose side is 1, with u to the left and v upwards."""
    bits = tag_bits(family)[number][::-1, ::-1].T
    modules = len(bits) + 2 * border
    edges = (border + np.arange(len(bits) + 1)) / modules - 0.5
    return shape(edges, edges, np.where(bits == 1, 2.0, 0.0))
