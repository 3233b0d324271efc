"""mrcal's corners.vnl (docs/formats.md): written from boards, read as arrays or as boards."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from rcdn.errors import FormatError, ImageError, shown
from rcdn.io.fields import read_text
from rcdn.io.files import write_chunks
from rcdn.io.formats import DECIMALS, ImageResult, rounded
from rcdn.io.images import read_named_image
from rcdn.io.vnl_grid import VnlGrid, grid_for
from rcdn.types import Array, Board, Corners, Orientation, Status
from rcdn.types.arrays import Real
from rcdn.types.ranges import POSITION

DECIDED = 3.0
"""The best guess of the number of columns is accepted if its lines are at least this many times straighter than those
of any other guess."""
ZIGZAG, ENOUGH = 0.55, 4
"""Second differences along the lines of a grid, × the first ones, above which its lines are zigzags (tilted boards have
up to .3, grids with another number of columns .8 and more), and the least number of either that tells."""


def write_vnl(
    path: str | Path, images: Iterable[ImageResult], size: tuple[int, int] | None = None
) -> tuple[int, int] | None:
    """Write mrcal's corners.vnl, whole or not at all. Returns the grid's (columns, rows), None if there are no boards.

    One board per image, row by row over the full grid, `- - -` for a missing corner; an image without a matching board
    has the single line `path - - -`. `size`: the grid (columns, rows), or None for the most frequent size of the
    complete boards. A board matches if the bounding box of its labels has the size of the grid, upright or rotated by a
    quarter turn; of several matching boards the one with the most corners is written.

    If most boards have decoded codes, the grid is that of their target (of a PuzzleBoard the part that any picture
    shows), and every visible part is written at its position on the target. AprilGrids have no uniform grid and are
    left out.

    `images` is iterated over twice; it may be a lazy iterable, so that the images need not fit into memory. Raises
    FormatError if `size` is None and boards were found, but none is complete or has a known position on its target, and
    for paths that mrcal can't read (white space, non-ASCII, a leading #); OutputError as `write_text`.
    """
    images = list(images) if isinstance(images, Iterator) else images
    grid = grid_for((image.boards for image in images), size)
    write_chunks(path, chain((b"# filename x y level\n",), (_vnl_lines(image, grid) for image in images)))
    return size if grid is None else grid.size


def read_vnl(path: str | Path) -> dict[str, Array]:
    """Read a corners.vnl: for each image, in the file's order, (N, 3) rows x, y, level; NaN for a missing corner.

    An image without a board has shape (0, 3). The file doesn't contain the grid's size; with a known size use
    `reshape(rows, columns, 3)`. A missing fourth column is read as level 0. Raises FormatError, naming file and line.
    """
    rows: dict[str, list[list[float]]] = {}
    for number, line in enumerate(read_text(path).splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            values = [np.nan if f == "-" else float(f) for f in fields[1:]]
        except ValueError:
            values = []
        if len(values) not in (2, 3):
            raise FormatError(f"{path}: line {number} must be `filename x y level`, not {shown(line.strip())}")
        if any(abs(v) > POSITION for v in values):
            raise FormatError(f"{path}: line {number}: positions must lie within ±{POSITION:g} px")
        level = values[2:] or [values[0] * 0]
        rows.setdefault(fields[0], []).append([*values[:2], *level])
    arrays = {name: np.array(r) for name, r in rows.items()}
    return {n: a if len(a) > 1 or np.isfinite(a[0, 0]) else np.zeros((0, 3)) for n, a in arrays.items()}


def read_vnl_boards(
    path: str | Path, size: tuple[int, int] | None = None, image_size: tuple[int, int] | None = None
) -> list[ImageResult]:
    """Read a corners.vnl as boards, one ImageResult for each image, in the file's order.

    The file contains neither the grid's `size` (columns, rows, in either order) nor the pictures' `image_size` (width,
    height). If `size` is None, it is guessed from the corners, whose lines are straight for only one number of columns.
    If `image_size` is None, the pictures are opened, relative to the current folder or to that of the file. Labels are
    those of the file, starting from 0 in the visible part; if the labels are left-handed in every image, the rows are
    counted from the other end. A level above 0 (found at a lower resolution) gives the status `low_confidence`; a
    negative level or position means a missing corner. The file doesn't record the squares' colours, so `orientation` is
    ambiguous. Raises FormatError, naming file and image, for a grid that doesn't match or can't be guessed, for labels
    that are mirrored in some images only, for corners beyond the right or lower border of the pictures, and for
    pictures that can't be opened.
    """
    table = {name: _present(rows) for name, rows in read_vnl(path).items()}
    seen = {name: rows for name, rows in table.items() if np.isfinite(rows[:, 0]).any()}
    cols, rows = size or _guess_size(path, list(seen.values()))
    for name, found in seen.items():
        if len(found) != cols * rows:
            raise FormatError(
                f"{path}: {name} has {len(found)} rows, but the grid {cols}×{rows} has {cols * rows}; give its size"
            )
    if size is not None:
        cols, rows = _straight_size(path, list(seen.values()), size)
    grids = _right_handed(path, {name: found.reshape(rows, cols, 3) for name, found in seen.items()})
    sizes = {name: image_size or _size_of_picture(path, name) for name in table}
    for name, grid in grids.items():
        _check_inside(path, name, grid, sizes[name])
    return [_result(name, grids.get(name), sizes[name]) for name in table]


# ---- boards → corners.vnl


def _vnl_lines(image: ImageResult, grid: VnlGrid | None) -> bytes:
    """The lines of one image: those of its largest matching board, or the line for none."""
    name = _vnl_name(image.path)
    missing = f"{name} - - -\n"
    grids = [g for board in image.boards if grid is not None and (g := grid.positions(board)) is not None]
    if not grids:
        return missing.encode()
    corners = rounded(max(grids, key=lambda g: np.isfinite(g[..., 0]).sum())).reshape(-1, 2)
    lines = (missing if x != x else f"{name} {x:.{DECIMALS}f} {y:.{DECIMALS}f} 0\n" for x, y in corners.tolist())
    return "".join(lines).encode()


def is_vnl_name(path: str) -> bool:
    """Whether mrcal can read this path of a picture: no white space, no other letters than ASCII's, no leading #."""
    return path.isascii() and path[:1] not in ("", "#") and not any(c.isspace() or not c.isprintable() for c in path)


def _vnl_name(path: str) -> str:
    if not is_vnl_name(path):
        raise FormatError(f"{path!r}: mrcal can't read paths with spaces, non-ASCII letters or a leading #; rename it")
    return path


# ---- corners.vnl → boards


def _present(rows: Array) -> Real[Array, "n 3"]:
    """The rows (N, 3) with NaN for each corner that the file marks as missing by a negative number."""
    bad = (rows[:, :2] < -0.5).any(axis=1) | (rows[:, 2] < 0) | ~np.isfinite(rows).all(axis=1)
    return np.where(bad[:, None], np.nan, rows)


def _guess_size(path: str | Path, tables: list[Array]) -> tuple[int, int]:
    """(columns, rows) of the grid, guessed from the straightness of its lines; arbitrary if there are no corners."""
    if not tables:
        return 2, 2
    many = len(tables[0])
    guesses = [c for c in range(2, many // 2 + 1) if many % c == 0 and all(len(t) == many for t in tables)]
    bends = sorted((_differences([t.reshape(many // c, c, 3)[..., :2] for t in tables], 2)[1], c) for c in guesses)
    if not bends or not np.isfinite(bends[0][0]) or (len(bends) > 1 and bends[1][0] < DECIDED * bends[0][0]):
        raise FormatError(f"{path}: the grid's size can't be told from its corners; give columns and rows (9x6)")
    return bends[0][1], many // bends[0][1]


def _straight_size(path: str | Path, tables: list[Array], size: tuple[int, int]) -> tuple[int, int]:
    """`size` (columns, rows), or the same in the other order if only its lines are straight. Raises FormatError if
    those of neither are."""
    if not _zigzags(tables, size):
        return size
    if not _zigzags(tables, size[::-1]):
        return size[1], size[0]
    raise FormatError(f"{path}: the lines of a grid of {size[0]}×{size[1]} corners are zigzags; give the board's size")


def _zigzags(tables: list[Array], size: tuple[int, int]) -> bool:
    """Whether the rows and columns of grids of `size` (columns, rows) go to and fro: their second differences are as
    large as the first ones. False where too few corners tell."""
    cols, rows = size
    grids = [t.reshape(rows, cols, 3)[..., :2] for t in tables]
    (few, step), (fewer, bend) = (_differences(grids, order) for order in (1, 2))
    return min(few, fewer) >= ENOUGH and bend > step * ZIGZAG


def _differences(grids: list[Array], order: int) -> tuple[int, float]:
    """The number of differences of this order along rows and columns of grids (rows, columns, 2), and their root mean
    square, px; infinite if there is none."""
    every = np.concatenate([np.diff(grid, order, axis=axis).reshape(-1, 2) for grid in grids for axis in (0, 1)])
    every = every[np.isfinite(every).all(axis=1)]
    return len(every), float(np.sqrt((every**2).sum(axis=1).mean())) if len(every) else np.inf


def _right_handed(path: str | Path, grids: dict[str, Array]) -> dict[str, Array]:
    """The grids, with the order of the rows reversed if the labels of every image are mirrored."""
    hands = {name: _hand(grid[..., :2]) for name, grid in grids.items()}
    mirrored = [name for name, hand in hands.items() if hand < 0]
    if mirrored and len(mirrored) < sum(hand != 0 for hand in hands.values()):
        raise FormatError(f"{path}: the labels of {mirrored[0]} are mirrored, those of other images not; drop one kind")
    return {name: grid[::-1] if mirrored else grid for name, grid in grids.items()}


def _hand(grid: Array) -> float:
    """The handedness of a grid: 1 if columns × rows has the orientation of x × y, −1 if the opposite, 0 if
    undetermined."""
    right, down = np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1]
    return float(np.sign(np.nansum(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])))


def _size_of_picture(path: str | Path, name: str) -> tuple[int, int]:
    reason = ""
    for place in (Path(name), Path(path).parent / name):
        try:
            height, width = read_named_image(place).shape
            return width, height
        except ImageError as error:
            reason = reason or str(error)
    raise FormatError(f"{path}: the size of a picture is not in the file, and {reason}; or give the image size")


def _check_inside(path: str | Path, name: str, grid: Array, size: tuple[int, int]) -> None:
    """Raise FormatError if a corner lies more than a pixel beyond the right or the lower border of its picture."""
    far = grid[..., :2] > np.array(size) + 0.5  # those beyond the left and the upper border count as missing
    if far.any():
        x, y = grid[far.any(axis=-1)][0, :2]
        raise FormatError(
            f"{path}: {name} has a corner at ({x:.0f}, {y:.0f}), outside of a picture of {size[0]}×{size[1]} px; "
            "give the size that it had when the corners were found"
        )


def _result(name: str, grid: Array | None, image_size: tuple[int, int]) -> ImageResult:
    if grid is None:
        nothing = np.zeros(0)
        return ImageResult(name, *image_size, Corners(np.zeros((0, 2)), nothing, nothing), ())
    j, i = np.nonzero(np.isfinite(grid[..., 0]))
    xy, level = grid[j, i, :2], grid[j, i, 2]
    status = np.where(level > 0, Status.LOW_CONFIDENCE, Status.REFINED)
    unknown = np.full(len(xy), np.nan)
    rows, cols = grid.shape[:2]
    orientation: Orientation = "ambiguous_90" if cols == rows else "ambiguous_180"
    ij = np.stack([i - i.min(), j - j.min()], axis=-1)
    board = Board(xy, ij, image_size, unknown, status, orientation)
    return ImageResult(name, *image_size, Corners(xy, unknown, status).sort(), (board,))
