"""Standard output and standard error that never stop a run: a full disk or a closed pipe is told at the end, or not at all."""

from __future__ import annotations

import errno
import io
import sys
from typing import Any, TextIO

from rcdn.terminal.group import FAILED, say_error


class _Quiet(io.RawIOBase):
    """What is written to `raw`; after the first `error` all else is dropped."""

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
    """Both streams, quiet from now on; `end` once all is said."""

    def __init__(self) -> None:
        self._below = sys.stdout, sys.stderr  # a stream that nobody holds closes what is below it
        self._out = _Quiet(_raw(sys.stdout))
        sys.stdout = _text(sys.stdout, self._out)
        sys.stderr = _text(sys.stderr, _Quiet(_raw(sys.stderr)))

    def end(self, code: int) -> int:
        """The exit code of a run that ended with `code`: it failed, too, if not all of its standard output could be written.

        A reader that has enough (`| head -1`) is no reason for words.
        """
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        error = self._out.error
        if error is None:
            return code
        if error.errno not in (errno.EPIPE, errno.EBADF):
            say_error(f"standard output: can't be written: {error.strerror or error}; write it to another place")
            sys.stderr.flush()
        return code or FAILED


def _raw(stream: TextIO | None) -> Any:
    """What is below the buffers of `stream`; None if it is closed, a console of Windows, or something else that can't be stacked anew."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # PYTHONUNBUFFERED leaves the buffer out
    return raw if isinstance(raw, io.FileIO) and sys.platform != "win32" else None


def _text(stream: Any, quiet: _Quiet) -> Any:
    """`stream` anew, over `quiet`; characters that its encoding lacks are written as escapes, not refused."""
    if quiet._raw is None:
        return stream
    stream.flush()
    errors = "backslashreplace" if stream.errors == "strict" else stream.errors
    options = {"line_buffering": stream.line_buffering, "write_through": stream.write_through}
    return io.TextIOWrapper(io.BufferedWriter(quiet), stream.encoding, errors, **options)
