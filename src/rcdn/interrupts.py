"""Handling of Ctrl-C in the command: it never interrupts an import and is never lost in a destructor.

This module imports little, because it is loaded before all others.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

AGAIN = 0.02
"""seconds after which a deferred Ctrl-C is raised again"""

_here = threading.local()
"""`held`: number of nested `held` blocks that this thread is in; `pressed`: Ctrl-C came within one of them. Only the
main thread is interrupted."""

_ended = False


def install() -> None:
    """Defer Ctrl-C to the end of an import: within one it would leave a half-initialised module, be turned into an
    ImportError, or be lost.

    Nothing changes where Ctrl-C is ignored (`nohup`), or where the system has no interval timers (Windows).
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or not hasattr(signal, "setitimer"):
        return
    signal.signal(signal.SIGALRM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _unraisable


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Defer Ctrl-C to the end of the block, where it is raised at once, for work that must not stop half-way: a thread
    would be left without being joined, or a line of output lost."""
    _here.held = getattr(_here, "held", 0) + 1
    try:
        yield
    finally:
        _here.held -= 1
        if not _here.held and getattr(_here, "pressed", False):
            _here.pressed = False
            signal.raise_signal(signal.SIGINT)


def end() -> None:
    """Ignore Ctrl-C from now on: only the report of the command's outcome is left to write."""
    global _ended
    _ended = True
    if signal.getsignal(signal.SIGINT) is _interrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)


def ended() -> bool:
    """Whether `end` was called: a further Ctrl-C is then not reported."""
    return _ended


def _interrupt(number: int, frame: FrameType | None) -> None:
    if getattr(_here, "held", 0):
        _here.pressed = True
    elif _importing(frame):
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    else:
        _here.pressed = False
        raise KeyboardInterrupt


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _unraisable(what: Any) -> None:
    """Schedule an interrupt again if it arrived where no exception can propagate; the default hook handles the rest."""
    if what.exc_type is KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, AGAIN)
    else:
        sys.__unraisablehook__(what)
