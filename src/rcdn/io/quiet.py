"""Suppressing OpenCV's messages on stderr during calls: errors are reported by rcdn's exceptions."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

_SILENT = 0
_set_level = cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel  # before OpenCV 5
_lock = threading.Lock()
_users, _before = 0, 0


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silence OpenCV's log within the context; the previous log level is restored when the last of several threads
    leaves."""
    global _users, _before
    with _lock:
        if _users == 0:
            _before = _set_level(_SILENT)
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                _set_level(_before)
