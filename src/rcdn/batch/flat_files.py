"""The files of `rcdn undistort`: pictures keep their names, and only files that rcdn wrote are overwritten."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.batch.work import explain
from rcdn.errors import OutputError

if TYPE_CHECKING:
    from rcdn.types import Array

DEPTHS = {
    ".png": ("uint8", "uint16"),
    ".tif": ("uint8", "uint16", "float32"),
    ".tiff": ("uint8", "uint16", "float32"),
    ".pgm": ("uint8", "uint16"),
    ".ppm": ("uint8", "uint16"),
    ".jp2": ("uint8", "uint16"),
    ".jpg": ("uint8",),
    ".jpeg": ("uint8",),
    ".bmp": ("uint8",),
    ".webp": ("uint8",),
}
"""pixel types that a file with this ending stores without loss of depth"""


@dataclass(frozen=True, eq=False)
class Source:
    """One picture of input number `index`, or the `error` if it could not be read. `place`: its output path before the
    pixel depth is taken into account."""

    index: int
    name: str
    place: Path
    pixels: Array | None
    error: str = ""


def sources(paths: Sequence[Path], folder: Path) -> Iterator[Source]:
    """The pictures of all `paths`, and the frames of videos as `video/000012.png`, with output paths below `folder`.
    A file that can't be read raises nothing: it gives a Source with an `error`."""
    from rcdn.io import colour_frames, is_video, read_pixels

    root = _root(paths)
    for index, path in enumerate(paths):
        place = folder / (os.path.relpath(os.path.abspath(path), root) if root else path.name)
        try:
            if is_video(path):
                for name, frame in colour_frames(path):
                    yield Source(index, name, place / f"{name.rpartition('#')[2]}.png", frame)
            else:
                yield Source(index, str(path), place, read_pixels(path))
        except Exception as error:  # whatever a decoder does
            yield Source(index, str(path), place, None, explain(error, str(path)))


class Places:
    """Assigns a different output file to each picture; an existing file only if rcdn wrote it, or with `overwrite`."""

    def __init__(self, overwrite: bool) -> None:
        self._overwrite = overwrite
        self._used: set[str] = set()

    def take(self, place: Path, dtype: str) -> Path:
        """The output file for pixels of `dtype`: `place`; with a further ending if its format can't store them, and
        with a number if the name is already in use.

        Raises OutputError if a file exists there that isn't marked as written by rcdn.
        """
        ending = place.suffix if dtype in DEPTHS.get(place.suffix.lower(), ()) else ""
        more = "" if ending else ".tif" if dtype == "float32" else ".png"
        stem = place.name.removesuffix(ending)
        names = chain((f"{stem}{ending}{more}",), (f"{stem}-{k}{ending}{more}" for k in count(2)))
        file = next(f for n in names if str(f := place.with_name(n)).lower() not in self._used)
        self._used.add(str(file).lower())
        self._check(file)
        return file

    def _check(self, file: Path) -> None:
        from rcdn.io.marks import mark_of

        if not self._overwrite and file.is_file() and mark_of(file) != "rcdn undistorted":
            raise OutputError(
                f"{file}: is there already, and not marked as written by rcdn; choose another --out, or --overwrite"
            )


def _root(paths: Sequence[Path]) -> str:
    """The common parent folder of all files; "" if they are on different drives."""
    try:
        return os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
    except ValueError:
        return ""
