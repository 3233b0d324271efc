"""Formats of files of detections, as `rcdn detect` and `rcdn convert` write them. Another format is another class here,
in FORMATS: both commands take it by the ending of a file's name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rcdn.errors import FormatError, many

if TYPE_CHECKING:
    from rcdn.io import ImageResult


@dataclass(frozen=True)
class Contents:
    """What is written: the `images`, which may be iterated over again; their records in JSON, `lines`; path and message
    of each file that failed; `size`: the board's columns and rows, None if not given."""

    images: Iterable[ImageResult]
    lines: Iterable[str]
    failed: Sequence[tuple[str, str]] = ()
    size: tuple[int, int] | None = None


class DetectionFormat(ABC):
    """A format of files of detections."""

    name: ClassVar[str]
    """of the format; the ending of its files, too"""
    squares_only: ClassVar[str] = ""
    """the reason why boards other than grids of squares have no place in a file; "" if they have"""

    def refusal(self, picture: str) -> str:
        """Why a file can't hold this path of a picture; "" if it can."""
        return ""

    @abstractmethod
    def write(self, path: Path, contents: Contents) -> tuple[int, int] | None:
        """Write a file. Returns the boards' columns and rows if a file has boards of one size only."""

    def left_out(self, contents: Contents, size: tuple[int, int] | None) -> list[str]:
        """Sentences on what a file doesn't hold of what was found; `size` as `write` returned it."""
        return []


class Json(DetectionFormat):
    """All that was found, in JSON."""

    name = "json"

    def write(self, path: Path, contents: Contents) -> tuple[int, int] | None:
        from rcdn.io import write_lines

        write_lines(path, contents.lines, contents.failed)
        return None


class Csv(DetectionFormat):
    """A table of the corners of boards."""

    name = "csv"

    def write(self, path: Path, contents: Contents) -> tuple[int, int] | None:
        from rcdn.io import write_csv

        write_csv(path, contents.images)
        return None

    def left_out(self, contents: Contents, size: tuple[int, int] | None) -> list[str]:
        return [f"left out: {', '.join(['responses', *_lost(contents)])}"]


class Vnl(DetectionFormat):
    """mrcal's corners.vnl."""

    name = "vnl"
    squares_only = "corners.vnl holds grids of squares only"

    def refusal(self, picture: str) -> str:
        from rcdn.io.vnl import is_vnl_name

        if is_vnl_name(picture):
            return ""
        return f"mrcal can't read the path {picture!r} (spaces, non-ASCII, #); rename it"

    def write(self, path: Path, contents: Contents) -> tuple[int, int] | None:
        from rcdn.io import write_vnl

        return write_vnl(path, contents.images, contents.size)

    def left_out(self, contents: Contents, size: tuple[int, int] | None) -> list[str]:
        boards = 0
        for image in contents.images:
            fit = size is not None and any(board.grid_of(size) is not None for board in image.boards)
            boards += len(image.boards) - fit
        parts = ["deviations and responses", *[many(boards, "board")] * (boards > 0), *_lost(contents)]
        held = [] if size is None else [f"holds one board of {size[0]}×{size[1]} corners a picture"]
        return [*held, f"left out: {', '.join(parts)}"]


def _lost(contents: Contents) -> list[str]:
    """The corners outside boards, and the files that failed, if there are any."""
    loose = sum(len(image.corners) - sum(map(len, image.boards)) for image in contents.images)
    parts = [many(loose, "corner outside boards", "corners outside boards")] * (loose > 0)
    failed = len(contents.failed)
    return parts + [many(failed, "file that could not be read", "files that could not be read")] * (failed > 0)


FORMATS: dict[str, DetectionFormat] = {format.name: format for format in (Json(), Vnl(), Csv())}
"""the formats by name"""


def format_of(path: Path, name: str | None = None, fix: str = "end the name with one") -> DetectionFormat:
    """The format of this `name`, or else that of the ending of `path`. Raises FormatError, with the advice `fix`, and
    if the ending is that of another format."""
    ending = path.suffix.lower().removeprefix(".")
    known = FORMATS.get(name or ending)
    if name and name != ending and ending in FORMATS:
        raise FormatError(f"{path}: the name ends as no {name} file does; end it with .{name}")
    if known is None:
        *most, last = FORMATS
        raise FormatError(f"{path}: detections are written as {', '.join(most)} or {last}; {fix}")
    return known
