"""Memory of a process, from Linux' /proc. Imports only the standard library."""

from __future__ import annotations

import sys
from pathlib import Path


def resident(field: str, process: int | str = "self") -> float | None:
    """`VmRSS` (present) or `VmHWM` (maximum since the program began) of a process, MB; None if the operating system
    does not report it.

    `getrusage` is not used: its ru_maxrss starts with the value of the parent process.
    """
    if not sys.platform.startswith("linux"):
        return None
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith(field + ":")), None)
