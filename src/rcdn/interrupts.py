"""Ctrl-C of the command: never in the middle of an import, nor lost in a destructor. It imports little: it is there before all else."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

AGAIN = 0.02
"""seconds after which a Ctrl-C that had to wait is tried again"""

_here = threading.local()
"""`held`: how many of them there are around what this thread runs; only the main thread is interrupted"""

_ended = False


def install() -> None:
    """Have Ctrl-C wait for the end of an import, where it would leave half a module, or be taken for an ImportError, or be lost.

    Nothing changes where Ctrl-C is ignored (`nohup`), or the system has no timers (Windows).
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or not hasattr(signal, "setitimer"):
        return
    signal.signal(signal.SIGALRM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _unraisable


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Have Ctrl-C wait for the end of the block, which would leave something half done: a thread that nobody waits for, a line that is lost."""
    _here.held = getattr(_here, "held", 0) + 1
    try:
        yield
    finally:
        _here.held -= 1


def end() -> None:
    """Ignore Ctrl-C from now on: all that is left is to say how it ended."""
    global _ended
    _ended = True
    if signal.getsignal(signal.SIGINT) is _interrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)


def ended() -> bool:
    """Whether `end` was called: nothing more is to be said of a Ctrl-C."""
    return _ended


def _interrupt(number: int, frame: FrameType | None) -> None:
    if getattr(_here, "held", 0) or _importing(frame):
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    else:
        raise KeyboardInterrupt


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _unraisable(what: Any) -> None:
    """An interrupt that came where nothing can be raised comes again."""
    if what.exc_type is KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    else:
        sys.__unraisablehook__(what)
