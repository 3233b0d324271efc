"""Lock that gives one process at a time exclusive access to the folder of a run."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

from rcdn.errors import ConfigError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

WAIT, WAITS = 0.2, 25
"""seconds between attempts to lock the folder of a run, and number of further attempts"""


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Lock the run's folder, which two processes must not write at once. Raises ConfigError if another one has locked
    it.

    The lock is retried for a few seconds, since the workers of a killed run may still hold it for moments.
    """
    if fcntl is None:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    held = os.open(folder, os.O_RDONLY)
    try:
        for attempt in range(WAITS + 1):
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if attempt == WAITS:
                    raise ConfigError(
                        f"{folder}: another process trains there now; wait for it, or give this run another `name`"
                    ) from None
                time.sleep(WAIT)
            except OSError:  # a file system without locks
                break
        yield
    finally:
        os.close(held)
