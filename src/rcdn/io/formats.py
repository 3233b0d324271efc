"""Detections as JSON and as mrcal's corners.vnl. Both are described field by field in docs/formats.md."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from rcdn.errors import FormatError, RcdnError
from rcdn.io.files import write_text
from rcdn.types import Array, Board, Corners, Orientation, Status

VERSION = 1
DECIMALS = 4


@dataclass(frozen=True, eq=False)
class ImageResult:
    """What was found in one image. `path` as the user gave it; `width`, `height` px; `boards` of this image.

    Raises RcdnError if a board's `image_size` is another one.
    """

    path: str
    width: int
    height: int
    corners: Corners
    boards: tuple[Board, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "boards", tuple(self.boards))
        for board in self.boards:
            if tuple(board.image_size) != (self.width, self.height):
                raise RcdnError(
                    f"{self.path}: a board has image_size {board.image_size}, the image {(self.width, self.height)}"
                )


def write_detections(path: str | Path, images: Sequence[ImageResult], errors: Sequence[tuple[str, str]] = ()) -> None:
    """Write detections as JSON (docs/formats.md), one image a line, numbers to 4 decimals; whole or not at all.

    `errors`: (path, message) of each file that failed. The same input gives the same bytes. Raises FormatError if a
    position isn't finite, OutputError if the file can't be written.
    """
    records = [_image_record(image) for image in images]
    failed = [{"path": name, "error": message} for name, message in errors]
    text = f'{{"version": {VERSION}, "images": {_lines(records)}, "errors": {_lines(failed)}}}\n'
    write_text(path, text)


def read_detections(path: str | Path) -> tuple[list[ImageResult], list[tuple[str, str]]]:
    """Read what `write_detections` wrote: (images, errors), equal to what was written but for the rounding.

    Unknown fields are passed over. Raises FormatError, naming the file and the field, if the file can't be read,
    isn't JSON, is of another version, or doesn't have the form of docs/formats.md.
    """
    try:
        data = json.loads(_read_text(path), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: not JSON ({error}); write it with `rcdn detect --json`") from error
    version = data.get("version") if isinstance(data, dict) else None
    if version != VERSION:
        raise FormatError(
            f"{path}: version must be {VERSION}, not {version!r}; write it again with `rcdn detect --json`"
        )
    records = _get(data, "images", list, str(path))
    failed = _get(data, "errors", list, str(path))
    images = [_image(record, f"{path}: images[{k}]") for k, record in enumerate(records)]
    where = f"{path}: errors"
    return images, [(_get(e, "path", str, where), _get(e, "error", str, where)) for e in failed]


def write_vnl(
    path: str | Path, images: Sequence[ImageResult], size: tuple[int, int] | None = None
) -> tuple[int, int] | None:
    """Write mrcal's corners.vnl, whole or not at all. Returns the grid's (columns, rows), None if there are no boards.

    One board an image, row by row over the full grid, `- - -` for a missing corner; an image without a board that
    fits has the one line `path - - -`. `size`: the grid (columns, rows), or None for the most frequent size of the
    complete boards. A board fits if the box of its labels is the grid's, upright or turned a quarter; of several that
    fit, the one with most corners is written. Raises FormatError if `size` is None and boards were found but none is
    complete, and for paths that mrcal can't read (white space, non-ASCII, a leading #); OutputError as `write_text`.
    """
    size = size or _usual_size(images)
    lines = ["# filename x y level"]
    for image in images:
        name = _vnl_name(image.path)
        grids = [g for board in image.boards if size and (g := board.grid_of(size)) is not None]
        if not grids:
            lines.append(f"{name} - - -")
            continue
        grid = max(grids, key=lambda g: np.isfinite(g[..., 0]).sum())
        for x, y in _rounded(grid).reshape(-1, 2):
            lines.append(f"{name} - - -" if np.isnan(x) else f"{name} {x:.{DECIMALS}f} {y:.{DECIMALS}f} 0")
    write_text(path, "\n".join(lines) + "\n")
    return size


def read_vnl(path: str | Path) -> dict[str, Array]:
    """Read a corners.vnl: for each image, in the file's order, (N, 3) rows x, y, level; NaN where a corner is missing.

    An image without a board has shape (0, 3). The file doesn't hold the grid's size: `reshape(rows, columns, 3)`.
    A missing fourth column reads as level 0. Raises FormatError, naming file and line.
    """
    rows: dict[str, list[list[float]]] = {}
    for number, line in enumerate(_read_text(path).splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            values = [np.nan if f == "-" else float(f) for f in fields[1:]]
        except ValueError:
            values = []
        if len(values) not in (2, 3):
            raise FormatError(f"{path}: line {number} must be `filename x y level`, not {line.strip()!r}")
        level = values[2:] or [values[0] * 0]
        rows.setdefault(fields[0], []).append([*values[:2], *level])
    arrays = {name: np.array(r) for name, r in rows.items()}
    return {n: a if len(a) > 1 or np.isfinite(a[0, 0]) else np.zeros((0, 3)) for n, a in arrays.items()}


def _read_text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file; check the path") from error
    except OSError as error:
        raise FormatError(f"{path}: can't be read ({error.strerror or error}); check the path") from error
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: not a text file; name the file that rcdn wrote") from error


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


# ---- values → JSON


def _lines(records: list[dict[str, Any]]) -> str:
    if not records:
        return "[]"
    try:
        return "[\n" + ",\n".join(json.dumps(r, allow_nan=False) for r in records) + "\n]"
    except ValueError as error:
        raise FormatError("detections: a position is not finite, and JSON has no number for it; drop it") from error


def _rounded(values: Array) -> Array:
    return np.round(np.asarray(values, float), DECIMALS) + 0.0  # + 0.0: no "-0.0"


def _optional(values: Array | None) -> list[Any] | None:
    """Rounded numbers, None for those that nobody knows."""
    if values is None:
        return None
    return [v if np.isfinite(v) else None for v in _rounded(values).tolist()]


def _names(status: Array) -> list[str]:
    return [Status(int(s)).name.lower() for s in status]


def _image_record(image: ImageResult) -> dict[str, Any]:
    corners = image.corners
    found: dict[str, Any] = {
        "xy": _rounded(corners.xy).tolist(),
        "response": _optional(corners.response),
        "status": _names(corners.status),
        "axes": None if corners.axes is None else [_optional(row) for row in corners.axes],
        "sigma": _optional(corners.sigma),
    }
    return {
        "path": image.path,
        "width": int(image.width),
        "height": int(image.height),
        "corners": {k: v for k, v in found.items() if v is not None},
        "boards": [_board_record(board) for board in image.boards],
    }


def _board_record(board: Board) -> dict[str, Any]:
    record: dict[str, Any] = {
        "ij": board.ij.tolist(),
        "xy": _rounded(board.xy).tolist(),
        "size": list(board.size),
        "complete": board.complete,
        "orientation": board.orientation,
        "response": _optional(board.response),
        "status": _names(board.status),
        "sigma": _optional(board.sigma),
    }
    return {k: v for k, v in record.items() if v is not None}


# ---- JSON → values


def _get(record: Any, key: str, kind: type, where: str) -> Any:
    if not isinstance(record, dict):
        raise FormatError(f"{where} must be an object")
    value = record.get(key)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        words = {list: "a list", dict: "an object", str: "text", int: "a whole number", bool: "true or false"}
        raise FormatError(f"{where}: {key!r} must be {words[kind]}")
    return value


def _numbers(record: dict[str, Any], key: str, where: str, finite: bool = False) -> Array:
    """The numbers of a field, null as NaN; the shape is checked by the value that they go into."""
    try:
        array = np.array(_get(record, key, list, where), dtype=float)
    except (ValueError, TypeError, OverflowError) as error:
        raise FormatError(f"{where}: {key!r} must hold numbers in rows of equal length") from error
    if finite and not np.isfinite(array).all():
        raise FormatError(f"{where}: {key!r} must hold finite numbers")
    return array


def _common(record: dict[str, Any], where: str) -> dict[str, Any]:
    """The fields that corners and boards share. Without a status a corner counts as refined."""
    xy = _numbers(record, "xy", where, finite=True)
    names = _get(record, "status", list, where) if "status" in record else ["refined"] * len(xy)
    known = {s.name.lower(): int(s) for s in Status}
    if unknown := [n for n in names if not isinstance(n, str) or n not in known]:
        raise FormatError(f"{where}: 'status' can't be {unknown[0]!r}; it is one of {', '.join(known)}")
    return {
        "xy": xy,
        "response": _numbers(record, "response", where) if "response" in record else np.full(len(xy), np.nan),
        "status": [known[n] for n in names],
        "sigma": _numbers(record, "sigma", where) if "sigma" in record else None,
    }


def _image(record: Any, where: str) -> ImageResult:
    path = _get(record, "path", str, where)
    size = _get(record, "width", int, where), _get(record, "height", int, where)
    corners = _get(record, "corners", dict, where)
    boards = [_board(b, size, f"{where}.boards[{k}]") for k, b in enumerate(_get(record, "boards", list, where))]
    where += ".corners"
    axes = _numbers(corners, "axes", where) if "axes" in corners else None
    common = _common(corners, where)
    try:
        return ImageResult(path, *size, Corners(axes=axes, **common), tuple(boards))
    except RcdnError as error:
        raise FormatError(f"{where}: {error}") from error


def _board(record: Any, image_size: tuple[int, int], where: str) -> Board:
    orientation: Orientation = _get(record, "orientation", str, where)
    if orientation not in get_args(Orientation):
        raise FormatError(f"{where}: 'orientation' must be one of {', '.join(get_args(Orientation))}")
    ij = _numbers(record, "ij", where, finite=True)
    if (ij != np.floor(ij)).any():
        raise FormatError(f"{where}: 'ij' must hold whole numbers")
    common = _common(record, where)
    try:
        board = Board(ij=ij, image_size=image_size, orientation=orientation, **common)
    except RcdnError as error:
        raise FormatError(f"{where}: {error}") from error
    if _get(record, "size", list, where) != list(board.size) or _get(record, "complete", bool, where) != board.complete:
        raise FormatError(f"{where}: 'size' and 'complete' must agree with 'ij', which gives {list(board.size)}")
    return board


# ---- boards → corners.vnl


def _vnl_name(path: str) -> str:
    if not path.isascii() or not path or any(c.isspace() or not c.isprintable() for c in path) or path[0] == "#":
        raise FormatError(f"{path!r}: mrcal can't read paths with spaces, non-ASCII letters or a leading #; rename it")
    return path


def _usual_size(images: Sequence[ImageResult]) -> tuple[int, int] | None:
    """The most frequent size of complete boards, upright and turned counted together; of equals the larger."""
    boards = [board for image in images for board in image.boards]
    sizes = Counter(board.size for board in boards if board.complete)
    if not boards:
        return None
    if not sizes:
        raise FormatError(
            "corners.vnl needs the board's size: no board is complete; give columns and rows (--board 9x6)"
        )
    either = Counter({s: n + sizes[s[::-1]] * (s[0] != s[1]) for s, n in sizes.items()})
    return max(either, key=lambda s: (either[s], s[0] * s[1], sizes[s], s))
