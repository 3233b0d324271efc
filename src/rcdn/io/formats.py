"""Detections as JSON, described field by field in docs/formats.md."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from rcdn.errors import FormatError, RcdnError, many, shown
from rcdn.io.fields import located, numbers, read_json, read_text, take
from rcdn.io.files import write_chunks
from rcdn.types import Array, Board, Corners, Orientation, Pattern, Status
from rcdn.types.ranges import LABEL, POSITION, whole_size
from rcdn.types.target import target_of, target_record

VERSION = 1
DECIMALS = 4


@dataclass(frozen=True, eq=False)
class ImageResult:
    """The detections of one image. `path` as the user gave it; `width`, `height` px; `boards` of this image;
    `warnings`: detections left out because of limits, if any (`Detection.warnings`).

    Raises RcdnError if the width and height aren't a valid size, or if a board has another `image_size`.
    """

    path: str
    width: int
    height: int
    corners: Corners
    boards: tuple[Board, ...]
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "boards", tuple(self.boards))
        object.__setattr__(self, "warnings", tuple(self.warnings))
        width, height = whole_size((self.width, self.height), f"{self.path}: width and height")
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "height", height)
        for board in self.boards:
            if tuple(board.image_size) != (self.width, self.height):
                raise RcdnError(
                    f"{self.path}: a board has image_size {board.image_size}, the image {(self.width, self.height)}"
                )

    def __repr__(self) -> str:
        found = f"{many(len(self.corners), 'corner')}, {many(len(self.boards), 'board')}"
        return f"<ImageResult {shown(self.path)} {self.width}×{self.height} px: {found}>"


def write_detections(path: str | Path, images: Sequence[ImageResult], errors: Sequence[tuple[str, str]] = ()) -> None:
    """Write detections as JSON (docs/formats.md), one image per line, numbers to 4 decimals; whole or not at all.

    `errors`: (path, message) of each file that failed. The same input gives the same bytes. Raises FormatError if a
    position isn't finite, RcdnError for what is no ImageResult, OutputError if the file can't be written.
    """
    write_lines(path, map(image_line, _named(images)), errors)


def _named(images: Iterable[ImageResult]) -> Iterator[ImageResult]:
    """The `images`; raises RcdnError for one that is no ImageResult, which has the name of its picture."""
    for k, image in enumerate(images):
        if not isinstance(image, ImageResult):
            raise RcdnError(
                f"images[{k}] must be an ImageResult(path, width, height, corners, boards), "
                f"not {type(image).__name__}: a file names its pictures"
            )
        yield image


def write_lines(path: str | Path, lines: Iterable[str], errors: Iterable[tuple[str, str]] = ()) -> None:
    """`write_detections` for images given by their lines (`image_line`), which need not fit into memory."""
    write_chunks(path, (piece.encode("ascii") for piece in _pieces(lines, errors)))


def image_line(image: ImageResult) -> str:
    """The record of one image in the file: a line of JSON without its line end. Raises FormatError if a position isn't
    finite."""
    return _line(_image_record(image))


def image_of_line(line: str) -> ImageResult:
    """The inverse of `image_line`: the image, equal up to rounding."""
    return _image(json.loads(line), "image")


def read_detections(path: str | Path) -> tuple[list[ImageResult], list[tuple[str, str]]]:
    """Read a file of `write_detections`: (images, errors), equal to those written up to rounding.

    Unknown fields are ignored. Raises FormatError, naming the file and the field, if the file can't be read, isn't
    JSON, is of another version, or doesn't have the structure of docs/formats.md.
    """
    data = read_json(path, read_text(path), "write it with `rcdn detect --json`")
    version = data.get("version") if isinstance(data, dict) else None
    if version != VERSION:
        raise FormatError(
            f"{path}: version must be {VERSION}, not {shown(version)}; write it again with `rcdn detect --json`"
        )
    if "kind" in data and "images" not in data:
        raise FormatError(
            f"{path}: no detections but of the kind {shown(data['kind'])}; give pictures, or a file of `rcdn detect`"
        )
    records = take(data, "images", list, str(path))
    failed = take(data, "errors", list, str(path))
    images = [_image(record, f"{path}: images[{k}]") for k, record in enumerate(records)]
    where = f"{path}: errors"
    return images, [(take(e, "path", str, where), take(e, "error", str, where)) for e in failed]


# ---- values → JSON


def _pieces(lines: Iterable[str], errors: Iterable[tuple[str, str]]) -> Iterator[str]:
    yield f'{{"version": {VERSION}, "images": '
    yield from _list(lines)
    yield ', "errors": '
    yield from _list(_line({"path": name, "error": message}) for name, message in errors)
    yield "}\n"


def _list(lines: Iterable[str]) -> Iterator[str]:
    before = "[\n"
    for line in lines:
        yield before + line
        before = ",\n"
    yield "[]" if before == "[\n" else "\n]"


def _line(record: dict[str, Any]) -> str:
    try:
        return json.dumps(record, allow_nan=False)
    except ValueError as error:
        raise FormatError("detections: a position is not finite, and JSON has no number for it; drop it") from error


def rounded(values: Array) -> Array:
    """`values` rounded to 4 decimals, as they are stored in files."""
    return np.round(np.asarray(values, float), DECIMALS) + 0.0  # + 0.0: no "-0.0"


def _optional(values: Array | None) -> list[Any] | None:
    """Rounded numbers (N,) or (N, 2), with None for unknown ones (NaN)."""
    if values is None:
        return None
    plain: list[Any] = rounded(values).tolist()
    if np.isfinite(values).all():
        return plain
    return [_known(row) for row in plain] if values.ndim > 1 else _known(plain)


def _known(values: list[float]) -> list[Any]:
    return [v if math.isfinite(v) else None for v in values]


_STATUS = {int(s): s.name.lower() for s in Status}


def _names(status: Array) -> list[str]:
    return [_STATUS[s] for s in status.tolist()]


def _image_record(image: ImageResult) -> dict[str, Any]:
    corners = image.corners
    found: dict[str, Any] = {
        "xy": rounded(corners.xy).tolist(),
        "response": _optional(corners.response),
        "status": _names(corners.status),
        "axes": _optional(corners.axes),
        "sigma": _optional(corners.sigma),
    }
    record = {
        "path": image.path,
        "width": int(image.width),
        "height": int(image.height),
        "corners": {k: v for k, v in found.items() if v is not None},
        "boards": [_board_record(board) for board in image.boards],
    }
    return record | ({"warnings": list(image.warnings)} if image.warnings else {})


def _board_record(board: Board) -> dict[str, Any]:
    record: dict[str, Any] = {
        "pattern": None if board.pattern == "checker" else board.pattern,
        "ij": board.ij.tolist(),
        "xy": rounded(board.xy).tolist(),
        "size": list(board.size),
        "complete": board.complete,
        "orientation": board.orientation,
        "origin_dark": board.origin_dark,
        "response": _optional(board.response),
        "status": _names(board.status),
        "sigma": _optional(board.sigma),
        "target": None if board.target is None else target_record(board.target),
        "ids": None if board.ids is None else board.ids.tolist(),
    }
    return {k: v for k, v in record.items() if v is not None}


# ---- JSON → values


def _common(record: dict[str, Any], where: str) -> dict[str, Any]:
    """The fields common to corners and boards. A corner without a status is taken to be refined."""
    xy = numbers(record, "xy", where, finite=True, within=POSITION)
    names = take(record, "status", list, where) if "status" in record else ["refined"] * len(xy)
    known = {name: number for number, name in _STATUS.items()}
    if unknown := [n for n in names if not isinstance(n, str) or n not in known]:
        raise FormatError(f"{where}: 'status' can't be {shown(unknown[0])}; it is one of {', '.join(known)}")
    return {
        "xy": xy,
        "response": numbers(record, "response", where) if "response" in record else np.full(len(xy), np.nan),
        "status": [known[n] for n in names],
        "sigma": numbers(record, "sigma", where) if "sigma" in record else None,
    }


def _image(record: Any, where: str) -> ImageResult:
    path = take(record, "path", str, where)
    given = take(record, "width", int, where), take(record, "height", int, where)
    with located(where):
        size = whole_size(given, "'width' and 'height'")
    corners = take(record, "corners", dict, where)
    boards = [_board(b, size, f"{where}.boards[{k}]") for k, b in enumerate(take(record, "boards", list, where))]
    warnings = take(record, "warnings", list, where) if "warnings" in record else []
    if not all(isinstance(text, str) for text in warnings):
        raise FormatError(f"{where}: 'warnings' must hold texts")
    where += ".corners"
    axes = numbers(corners, "axes", where) if "axes" in corners else None
    common = _common(corners, where)
    with located(where):
        return ImageResult(path, *size, Corners(axes=axes, **common), tuple(boards), tuple(warnings))


def _board(record: Any, image_size: tuple[int, int], where: str) -> Board:
    orientation: Orientation = take(record, "orientation", str, where)
    if orientation not in get_args(Orientation):
        raise FormatError(f"{where}: 'orientation' must be one of {', '.join(get_args(Orientation))}")
    ij = numbers(record, "ij", where, finite=True, within=LABEL)
    if (ij != np.floor(ij)).any():
        raise FormatError(f"{where}: 'ij' must hold whole numbers")
    pattern: Any = take(record, "pattern", str, where) if "pattern" in record else "checker"
    if pattern not in get_args(Pattern):
        raise FormatError(f"{where}: 'pattern' must be one of {', '.join(get_args(Pattern))}")
    common = _common(record, where)
    with located(where):
        target = target_of(record["target"]) if "target" in record else None
        ids = numbers(record, "ids", where, finite=True) if "ids" in record else None
        dark = take(record, "origin_dark", bool, where) if "origin_dark" in record else None
        board = Board(
            ij=ij, image_size=image_size, orientation=orientation, pattern=pattern, target=target, ids=ids,
            origin_dark=dark, **common,
        )  # fmt: skip
    if take(record, "size", list, where) != list(board.size) or take(record, "complete", bool, where) != board.complete:
        raise FormatError(f"{where}: 'size' and 'complete' must agree with 'ij', which gives {list(board.size)}")
    return board
