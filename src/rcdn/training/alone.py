"""One process at a time in the folder of a run."""

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
"""seconds, and how often, that the folder of a run is waited for"""


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Hold the run's folder, which two processes must not write at once. Raises ConfigError if another one holds it.

    What the workers of a run that was killed still hold, they let go within moments.
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
