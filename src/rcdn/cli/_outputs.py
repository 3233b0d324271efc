"""Detections on their way to their files: on the disk meanwhile, so that memory doesn't grow with the pictures."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.cli._batch import Failure
    from rcdn.cli._options import GridSize
    from rcdn.io import ImageResult


class Outputs:
    """The files that a run writes at its end, whole or not at all. Close it, used or not.

    The lines of the pictures wait in a file without a name, on the disk that takes the result: nothing is left of it however the run ends.
    """

    def __init__(self, json: Path | None, vnl: Path | None, board: GridSize | None) -> None:
        self._json, self._vnl, self._board = json, vnl, board
        self._lines: IO[bytes] | None = None

    @property
    def wanted(self) -> bool:
        """True if `add` needs the lines."""
        return self._json is not None or self._vnl is not None

    def add(self, line: str) -> None:
        """Keep the line of the next picture. Raises OutputError if the disk is full."""
        from rcdn.io.files import output_error

        path = self._json or self._vnl
        if path is None:
            return
        try:
            if self._lines is None:
                self._lines = _nameless(path)
            self._lines.write(line.encode("ascii") + b"\n")
        except OSError as error:
            raise output_error(path, error) from error

    def write(self, failures: Sequence[Failure]) -> list[RcdnError]:
        """Write what is asked for. One file that can't be written doesn't stop the other; returns what went wrong."""
        from rcdn.io import write_lines, write_vnl

        wrong: list[RcdnError] = []
        try:
            if self._json is not None:
                write_lines(self._json, self._kept(), ((f.name, f.message) for f in failures))
        except RcdnError as error:
            wrong.append(error)
        try:
            if self._vnl is not None:
                write_vnl(self._vnl, _Images(self), self._board)
        except RcdnError as error:
            wrong.append(error)
        return wrong

    def close(self) -> None:
        if self._lines is not None:
            with suppress(OSError):  # a full disk, which was told already
                self._lines.close()

    def _kept(self) -> Iterator[str]:
        if self._lines is not None:
            self._lines.seek(0)
            for line in self._lines:
                yield line[:-1].decode("ascii")


class _Images:
    """The images that wait, read anew each time."""

    def __init__(self, outputs: Outputs) -> None:
        self._outputs = outputs

    def __iter__(self) -> Iterator[ImageResult]:
        from rcdn.io import image_of_line

        return map(image_of_line, self._outputs._kept())


def _nameless(path: Path) -> IO[bytes]:
    """A file without a name on the disk of `path`, or where temporary files are if `path` is a device or a pipe. Raises OSError."""
    from rcdn.io.files import is_special

    if is_special(path):
        return tempfile.TemporaryFile()
    folder = Path(os.path.realpath(path)).parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return tempfile.TemporaryFile(dir=folder)
