"""Suppressing OpenCV's messages on stderr during calls: errors are reported by rcdn's exceptions."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

_SILENT = 0
_set_level = cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel  # before OpenCV 5
_lock = threading.Lock()
_users: set[object] = set()
_before: list[int] = []
"""the level to restore, while there are users"""


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silence OpenCV's log within the context; the previous log level is restored when the last of several threads
    leaves. A process that is forked meanwhile has the previous level, too."""
    user = object()
    try:
        _enter(user)
        yield
    finally:
        try:
            _leave(user)
        except BaseException:
            _leave(user)
            raise


def _enter(user: object) -> None:
    with _lock:
        _users.add(user)
        if not _before:
            _before.extend(map(_set_level, [_SILENT]))  # one step for Python: an interrupt can't lose the level


def _leave(user: object) -> None:
    """Forget `user`, and restore the level if no other is left; again, if it was interrupted."""
    with _lock:
        _users.discard(user)
        if not _users:
            _restore()


def _restore() -> None:
    if _before:
        _set_level(_before[0])
        _before.clear()


def _after_fork() -> None:
    """Restore the level: a forked process has none of the threads that would, and maybe a lock that is never
    released."""
    global _lock
    _lock = threading.Lock()
    _users.clear()
    _restore()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
