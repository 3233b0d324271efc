"""Output of detections: lines are buffered on disk until the end, so that memory use doesn't grow with the pictures."""

from __future__ import annotations

import errno
import io
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from rcdn.batch.detection_files import Contents, DetectionFormat
from rcdn.errors import OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.batch.work import Failure
    from rcdn.io import ImageResult
    from rcdn.terminal.options import GridSize

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""error numbers of a disk that is full, or of an exhausted quota"""


class Outputs:
    """The files that a run writes at its end, each whole or not at all. Must be closed, whether used or not.

    The pictures' lines are buffered in an unnamed temporary file, which disappears however the run ends. `written`: the
    files that have been written.
    """

    def __init__(self, files: Mapping[Path, DetectionFormat], board: GridSize | None = None) -> None:
        self._files, self._board = files, board
        self._spool = Spool([_folder(path) for path in files])
        self.written: list[Path] = []

    @property
    def wanted(self) -> bool:
        """True if `add` needs the lines."""
        return bool(self._files)

    def add(self, line: str) -> None:
        """Buffer the line of the next picture. Raises OutputError if no disk of an output file has room for the lines
        so far."""
        from rcdn.io.files import output_error

        if not self._files:
            return
        path = next(iter(self._files))
        try:
            self._spool.add(line.encode("ascii") + b"\n")
        except OSError as error:
            raise output_error(path, error) from error
        if self._spool.refused is not None:
            raise output_error(path, self._spool.refused)

    def write(self, failures: Sequence[Failure]) -> list[RcdnError]:
        """Write the requested files, and return the errors. An error with one file doesn't stop the others."""
        failed = [(failure.name, failure.message) for failure in failures]
        wrong = [self._try(path, format, failed) for path, format in self._files.items()]
        return [error for error in wrong if error is not None]

    def close(self) -> None:
        self._spool.close()

    def _try(self, path: Path, format: DetectionFormat, failed: Sequence[tuple[str, str]]) -> RcdnError | None:
        from rcdn.io.files import output_error

        for _ in range(2):
            try:
                format.write(path, Contents(_Images(self), self._kept(), failed, self._board))
            except RcdnError as error:
                cause = error.__cause__
                if isinstance(cause, OSError) and cause.errno in FULL and self._spool.leave(_folder(path)):
                    continue  # the buffered lines themselves had filled the disk
                return error
            except OSError as error:
                return output_error(path, error)
            self.written.append(path)
            return None
        return OutputError(f"{path}: can't be written: its disk is full; make room, or write to another disk")

    def _kept(self) -> Iterator[str]:
        for line in self._spool:
            yield line[:-1].decode("ascii")


class _Images:
    """The images whose lines are buffered; each iteration reads them again."""

    def __init__(self, outputs: Outputs) -> None:
        self._outputs = outputs

    def __iter__(self) -> Iterator[ImageResult]:
        from rcdn.io import image_of_line

        return map(image_of_line, self._outputs._kept())


class Spool:
    """Lines in an unnamed file on the disk of the first of the `folders` that has room, else in the folder of temporary
    files.

    After any error it still contains all lines that were added, whole and in order. `refused`: the error because of
    which none of the `folders` is used any more.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = list(dict.fromkeys(folders))
        self._file: IO[bytes] | None = None
        self._disk = -1
        self._end = 0
        self.refused: OSError | None = None

    def add(self, line: bytes) -> None:
        """Append a line. Raises OSError, without appending it, if no disk has room for it."""
        try:
            if self._file is None:
                self._file = _nameless(self._folders[0])
                self._disk = os.fstat(self._file.fileno()).st_dev
            _append(self._file, self._end, line)
        except OSError as error:
            if self._file is not None:
                with suppress(OSError):
                    self._file.truncate(self._end)
            file = self._move(self._disk, line)
            if file is None:
                raise
            if self._disk not in {_disk(f) for f in self._folders}:
                self.refused = error
        self._end += len(line)

    def leave(self, folder: Path) -> bool:
        """Move the lines from the disk of `folder` to another one, to make room; False if they aren't on that disk, or
        no other disk has room for them."""
        return self._file is not None and self._disk == _disk(folder) and self._move(self._disk, b"") is not None

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def __iter__(self) -> Iterator[bytes]:
        """The lines. Raises OSError."""
        if self._file is None:
            return
        self._file.seek(0)
        reader, left = io.BufferedReader(self._file), self._end  # type: ignore[type-var]
        try:
            while left > 0 and (line := reader.readline()):
                left -= len(line)
                yield line
        finally:
            with suppress(ValueError):  # the file is closed if the lines have been moved meanwhile
                reader.detach()

    def _move(self, full: int, line: bytes) -> IO[bytes] | None:
        """Copy all lines, and then `line`, to a disk other than `full`; None if no other disk has room."""
        for folder in (*self._folders, _temporary()):
            if _disk(folder) in (full, -1):
                continue
            try:
                file = _nameless(folder)
                at = 0
                for kept in self:
                    _append(file, at, kept)
                    at += len(kept)
                _append(file, at, line)
            except OSError:
                continue
            self.close()
            self._file, self._disk = file, os.fstat(file.fileno()).st_dev
            return file
        return None


def _append(file: IO[bytes], at: int, data: bytes) -> None:
    """Write all of `data` at position `at`: a single write may be partial on a disk that fills up."""
    file.seek(at)
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


def _disk(folder: Path) -> int:
    try:
        return os.stat(folder).st_dev
    except OSError:
        return -1


def _nameless(folder: Path) -> IO[bytes]:
    """An unnamed temporary file, unbuffered, so that errors appear at the write that causes them. Raises OSError."""
    return tempfile.TemporaryFile(dir=folder, buffering=0)


def _folder(path: Path) -> Path:
    """The folder of `path`, or its nearest existing parent; the folder of temporary files if `path` is a device or a
    pipe."""
    from rcdn.io.files import is_stream

    if is_stream(path):
        return _temporary()
    folder = Path(os.path.realpath(path)).parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder


def _temporary() -> Path:
    """The folder of temporary files; the current folder if there is no such folder, or none can be written."""
    try:
        return Path(tempfile.gettempdir())
    except OSError:
        return Path.cwd()
