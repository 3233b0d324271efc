"""Every printable target as shapes in metres, for printing, rendering and tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcdn.errors import ConfigError
from rcdn.targets.dictionaries import dictionary_names, marker_bits, tag_bits
from rcdn.targets.layout import markers_in, odd_markers
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.types import AprilGrid, Array, Charuco, Checkerboard, Deltille, Print, Printed, PuzzlePart
from rcdn.types.arrays import Real
from rcdn.types.plane import ROW
from rcdn.types.shapes import Area, Disc, Point, Rect, Shape

CIRCLE = 1 / 6
"""radius of a PuzzleBoard's circles, squares"""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A target as printed: `shapes` within (0, 0) to (`width`, `height`), m, x right, y down; the rest is white.

    `corners` (N, 2): positions of the corners, m, in the order of `Printed.ids`.
    """

    width: float
    height: float
    shapes: tuple[Shape, ...]
    corners: Array


def draw(printed: Printed) -> Drawing:
    """The drawing of a target, upright. Raises ConfigError for a dictionary that is unknown or has too few markers, and
    for unknown rows."""
    target, spacing = printed.target, printed.spacing
    check(target)
    width, height = extent(target)
    shapes = tuple(shape.placed(spacing, 0.0, 0.0) for shape in _shapes(target))
    return Drawing(width * spacing, height * spacing, shapes, _on_sheet(target) * spacing)


def extent(target: Print) -> tuple[float, float]:
    """Width and height of the print, in sides of a square, triangle or tag."""
    columns, rows = target.columns, target.rows or 0
    if isinstance(target, Charuco):
        return float(columns), float(rows)
    if isinstance(target, AprilGrid):
        return columns * (1 + target.gap) + target.gap, rows * (1 + target.gap) + target.gap
    if isinstance(target, Deltille):
        return columns + 1.5, (rows + 1) * ROW
    return columns + 1.0, rows + 1.0


def check(target: Print) -> None:
    """Raise ConfigError unless the target can be drawn: its markers are in its dictionary, and its number of rows is
    known."""
    if target.rows is None:
        raise ConfigError(f"{target}: how many rows it has must be known to print it")
    if isinstance(target, Charuco):
        bits, count = marker_bits(target.dictionary), _markers(target)
        _check_count(target.dictionary, len(bits), target.first_id, count, "markers")
    elif isinstance(target, AprilGrid):
        if target.border not in (1, 2):
            raise ConfigError(f"a tag's border is 1 or 2 bits wide (Kalibr's 2), not {target.border}")
        _check_count(target.family, len(tag_bits(target.family)), target.first_id, target.columns * target.rows, "tags")


def _markers(board: Charuco) -> int:
    squares = board.columns * (board.rows or 0)
    return squares // 2 if odd_markers(board) else (squares + 1) // 2


def _check_count(name: str, has: int, first: int, count: int, what: str) -> None:
    if first + count > has:
        larger = [n for n in dictionary_names() if n.rsplit("_", 1)[0] == name.rsplit("_", 1)[0]]
        fits = next((n for n in larger if len(marker_bits(n)) >= first + count), None)
        advice = f"take {fits}" if fits else "take a smaller board, or a lower first number"
        begin = f" from {first}" if first else ""
        raise ConfigError(f"{name} has {has} {what}, but the board needs {count}{begin}; {advice}")


def _on_sheet(target: Print) -> Real[Array, "n 2"]:
    """Positions of the corners on the upright sheet, (N, 2), in the order of their numbers."""
    plane = target.plane(target.places())
    if isinstance(target, AprilGrid):  # labels count from the bottom right, to the left and upwards
        return np.array(extent(target)) - target.gap - plane
    if isinstance(target, PuzzlePart):
        return plane - np.array([target.column - 1, target.row - 1])
    return plane + np.array([1.0, ROW if isinstance(target, Deltille) else 1.0])


def _shapes(target: Print) -> Iterator[Shape]:
    if isinstance(target, Charuco):
        return _charuco(target)
    if isinstance(target, AprilGrid):
        return _aprilgrid(target)
    if isinstance(target, Deltille):
        return _deltille(target)
    return _squares(target)


def _squares(target: Checkerboard | PuzzlePart) -> Iterator[Shape]:
    white = (target.column + target.row) % 2 if isinstance(target, PuzzlePart) else 0
    for row in range(target.rows + 1):
        for column in range(target.columns + 1):
            if (column + row) % 2 == white:
                yield Rect(column, row, 1.0, 1.0)
    if isinstance(target, PuzzlePart):
        yield from _circles(target)


def _circles(part: PuzzlePart) -> Iterator[Disc]:
    """A circle at the middle of every edge, including those that end at the rim. The sheet's corner (1, 1) is the
    part's first."""
    for row in range(part.rows + 1):
        for column in range(part.columns + 1):
            x, y = part.column - 1 + column, part.row - 1 + row  # position on the code
            if row:
                yield Disc(column + 0.5, row, CIRCLE, CODE_2[x % 3][y % 167] == "1")
            if column:
                yield Disc(column, row + 0.5, CIRCLE, CODE_1[y % 3][x % 167] == "1")


def _deltille(target: Deltille) -> Iterator[Area]:
    """The black triangles that touch an inner corner."""
    inner = target.places()
    first = np.unique(np.concatenate([inner, inner - np.array([1, 0]), inner - np.array([0, 1])])[:, ::-1], axis=0)[
        :, ::-1
    ]
    xy = target.plane(first[:, None] + np.array([(0, 0), (1, 0), (0, 1)])) + np.array([1.0, ROW])
    for triangle in xy.tolist():
        yield Area((tuple((x, y) for x, y in triangle),))


def _charuco(board: Charuco) -> Iterator[Shape]:
    """Markers lie in the white squares; on an inverted board black and white are exchanged."""
    bits = marker_bits(board.dictionary)
    margin = (1 - board.marker) / 2
    for row in range(board.rows or 0):
        for column in range(board.columns):
            corners = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
            number, marked = markers_in(board, np.array([column, row]))
            if marked:
                loops = _marker(bits[int(number)], 1, board.marker, column + margin, row + margin)
                yield Area((corners, *loops) if board.inverted else loops)
            elif not board.inverted:
                yield Rect(column, row, 1.0, 1.0)


def _aprilgrid(grid: AprilGrid) -> Iterator[Shape]:
    """Tags row by row upwards from the bottom left, and a small black square at every crossing of the gaps."""
    bits, step, rows = tag_bits(grid.family), 1 + grid.gap, grid.rows or 0
    for row in range(rows + 1):
        for column in range(grid.columns + 1):
            yield Rect(column * step, row * step, grid.gap, grid.gap)
    for row in range(rows):
        for column in range(grid.columns):
            number = grid.first_id + (rows - 1 - row) * grid.columns + column
            yield Area(_marker(bits[number], grid.border, 1.0, column * step + grid.gap, row * step + grid.gap))


def _marker(bits: Array, border: int, side: float, left: float, top: float) -> tuple[tuple[Point, ...], ...]:
    """The outline of a marker's black modules, including its border of `border` modules."""
    black = np.pad(bits == 0, border, constant_values=True)
    module = side / len(black)
    return tuple(tuple((left + x * module, top + y * module) for x, y in loop) for loop in outline(black))


def outline(cells: Array) -> list[list[tuple[int, int]]]:
    """Closed loops of points (x, y) around the true `cells` (rows, columns): a single shape prints without seams
    between cells.

    Only points at which a loop turns; the cells lie to the right of its direction (y down). Where two cells touch at a
    corner, loops may touch, too: fill by the even-odd rule.
    """
    after: dict[tuple[int, int], list[tuple[int, int]]] = {}
    padded = np.pad(np.asarray(cells, bool), 1)
    for y, x in np.argwhere(padded).tolist():
        for dy, dx, start, end in (
            (-1, 0, (-1, -1), (0, -1)),
            (0, 1, (0, -1), (0, 0)),
            (1, 0, (0, 0), (-1, 0)),
            (0, -1, (-1, 0), (-1, -1)),
        ):
            if not padded[y + dy, x + dx]:
                after.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    loops = []
    while after:
        loop = [next(iter(after))]
        while (here := loop[-1]) in after:
            ends = after[here]
            loop.append(ends.pop())
            if not ends:
                del after[here]
        loops.append(_corners_of(loop[:-1]))
    return loops


def _corners_of(loop: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The points at which a closed loop turns."""
    ways = zip(loop[-1:] + loop[:-1], loop, loop[1:] + loop[:1], strict=True)
    return [b for a, b, c in ways if (b[0] - a[0]) * (c[1] - b[1]) != (b[1] - a[1]) * (c[0] - b[0])]
