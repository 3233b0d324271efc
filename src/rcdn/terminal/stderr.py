"""Standard error reserved for rcdn's own messages: libraries (libpng, libjpeg, FFmpeg, …) write to its file descriptor
directly, bypassing Python."""

from __future__ import annotations

import contextlib
import faulthandler
import io
import os
import sys

READERS = frozenset({"detect", "calibrate", "pose", "report", "undistort", "convert"})
"""verbs that decode pictures"""


def for_ours_alone() -> None:
    """Discard anything written to file descriptor 2, in this process and its child processes, while `sys.stderr` keeps
    working.

    No information is lost, since rcdn reports its own error for each picture. Only for the command line, since file
    descriptors belong to the whole process.
    """
    if sys.stderr is None or sys.platform == "win32":  # the Windows console is not a descriptor
        return
    with contextlib.suppress(OSError, ValueError, io.UnsupportedOperation):  # closed, or not on descriptor 2
        if sys.stderr.fileno() != 2:
            return
        sys.stderr.flush()
        ours = open(os.dup(2), "w", buffering=1, encoding=sys.stderr.encoding, errors=sys.stderr.errors)  # noqa: SIM115
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 2)
        os.close(nowhere)
        sys.stderr = ours
        if faulthandler.is_enabled():
            faulthandler.enable(ours)
