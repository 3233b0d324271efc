"""Standard error for our own lines: the libraries under us (libpng, libjpeg, FFmpeg, …) print to its descriptor past Python."""

from __future__ import annotations

import contextlib
import faulthandler
import io
import os
import sys

READERS = frozenset({"detect", "calibrate", "pose", "report", "undistort", "convert"})
"""verbs that decode pictures"""


def for_ours_alone() -> None:
    """`sys.stderr` goes on as it is; what is written to descriptor 2 goes nowhere, here and in the processes that are started.

    What those lines tell of a picture is in our error for it. For a command line only: descriptors belong to the whole program.
    """
    if sys.stderr is None or sys.platform == "win32":  # a console of Windows is no descriptor
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
