"""Inputs that failed, again: in this process, with the whole traceback."""

from __future__ import annotations

import faulthandler
import json
import traceback
import warnings
from pathlib import Path

from tests.fuzz import kernels


def replay(path: Path, minimise: bool = False) -> int:
    """Run the input of a file that a campaign kept; 1 if it still fails."""
    kernels.record()
    faulthandler.enable()
    from rcdn.errors import RcdnError
    from tests.fuzz.source import Source
    from tests.fuzz.targets import TARGETS

    kept = json.loads(path.read_text())
    target, data = TARGETS[kept["target"]], bytes.fromhex(kept["data"])
    if minimise:
        data = smallest(target, data)
        path.write_text(json.dumps(kept | {"data": data.hex()}, indent=1) + "\n")
    given = target.make(Source(data))
    print(f"{path}: {target.name}: {given!r:.1500}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            target.check(given)
    except RcdnError as error:
        print(f"refused: {type(error).__name__}: {error}")
        return 0
    except Exception:
        traceback.print_exc()
        return 1
    print("fine")
    return 0


def smallest(target, data: bytes) -> bytes:
    """Fewer choices, or plainer ones, that fail in the same place. Not for what ends the process."""
    from tests.fuzz.guard import Guard

    guard = Guard(target)
    failure = guard.run(data)
    if failure is None:
        return data
    size = max(1, len(data) // 2)
    while size:
        at = 0
        while at < len(data):
            for less in (data[:at] + data[at + size :], data[:at] + bytes(len(data[at : at + size])) + data[at + size :]):
                again = guard.run(less) if less != data else None
                if again is not None and again.key == failure.key:
                    data = less
                    break
            at += size
        size //= 2
    return data.rstrip(b"\0")
