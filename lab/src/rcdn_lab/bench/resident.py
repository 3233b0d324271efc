"""Memory of a process, from Linux' /proc. Imports nothing but the standard library."""

from __future__ import annotations

import sys
from pathlib import Path


def resident(field: str, process: int | str = "self") -> float | None:
    """`VmRSS` (now) or `VmHWM` (at most, since the program began) of a process, MB; None where the system doesn't tell.

    Not `getrusage`: its ru_maxrss begins with what the parent had.
    """
    if not sys.platform.startswith("linux"):
        return None
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith(field + ":")), None)
