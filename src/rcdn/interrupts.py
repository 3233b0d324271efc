"""Ctrl-C of the command: never in the middle of an import, nor lost in a destructor. It imports little: it is there before all else."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Any

AGAIN = 0.02
"""seconds after which a Ctrl-C that had to wait is tried again"""


def install() -> None:
    """Have Ctrl-C wait for the end of an import, where it would leave half a module, or be taken for an ImportError, or be lost.

    Nothing changes where Ctrl-C is ignored (`nohup`), or the system has no timers (Windows).
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or not hasattr(signal, "setitimer"):
        return
    signal.signal(signal.SIGALRM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)
    sys.unraisablehook = _unraisable


def end() -> None:
    """Ignore Ctrl-C from now on: everything is done but the interpreter's own end."""
    if signal.getsignal(signal.SIGINT) is _interrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _importing(frame):
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
