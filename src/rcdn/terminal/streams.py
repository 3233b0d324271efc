"""Standard streams that never abort a run: a full disk is reported at the end, a closed pipe not at all."""

from __future__ import annotations

import errno
import io
import sys
from typing import Any, TextIO

from rcdn.terminal.group import FAILED, print_error


class _Quiet(io.RawIOBase):
    """Stream that writes to `raw`; after the first `error`, all further output is discarded."""

    def __init__(self, raw: Any) -> None:
        self._raw = raw
        self.error: OSError | None = None

    def write(self, data: Any) -> int | None:
        if self.error is None:
            try:
                return self._raw.write(data)
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        return bool(self._raw.isatty())


class Streams:
    """Replaces both standard streams by ones that don't raise errors; call `end` after all output."""

    def __init__(self) -> None:
        self._below = sys.stdout, sys.stderr  # kept, since a deleted stream closes its raw stream
        self._out = _Quiet(_raw(sys.stdout))
        sys.stdout = _text(sys.stdout, self._out)
        sys.stderr = _text(sys.stderr, _Quiet(_raw(sys.stderr)))

    def end(self, code: int) -> int:
        """The exit code of a run that ended with `code`: the run has also failed if its standard output could not be
        written completely.

        A reader that closes the pipe early (`| head -1`) causes no message.
        """
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        error = self._out.error
        if error is None:
            return code
        if error.errno not in (errno.EPIPE, errno.EBADF):
            print_error(f"standard output: can't be written: {error.strerror or error}; write it to another place")
            sys.stderr.flush()
        return code or FAILED


def _raw(stream: TextIO | None) -> Any:
    """The raw stream below the buffers of `stream`; None if it is closed, a Windows console, or another type that can't
    be wrapped again."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # with PYTHONUNBUFFERED there is no buffer
    return raw if isinstance(raw, io.FileIO) and sys.platform != "win32" else None


def _text(stream: Any, quiet: _Quiet) -> Any:
    """`stream` wrapped again, over `quiet`; characters that its encoding lacks are written as escapes."""
    if quiet._raw is None:
        return stream
    stream.flush()
    errors = "backslashreplace" if stream.errors == "strict" else stream.errors
    options = {"line_buffering": stream.line_buffering, "write_through": stream.write_through}
    return io.TextIOWrapper(io.BufferedWriter(quiet), stream.encoding, errors, **options)
