"""Inputs that failed, again: in this process, with the whole traceback."""

from __future__ import annotations

import faulthandler
import json
import traceback
import warnings
from pathlib import Path

from tests.fuzz import kernels
from tests.fuzz.guard import Guard
from tests.fuzz.target import Target


def replay(path: Path, minimise: bool = False) -> int:
    """Run the input of a file that a campaign kept; 1 if it still fails."""
    kernels.record()
    faulthandler.enable()
    from tests.fuzz.source import Source
    from tests.fuzz.targets import TARGETS

    from rcdn.errors import RcdnError

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


def smallest(target: Target, data: bytes) -> bytes:
    """Fewer choices, or plainer ones, that fail in the same place. Not for what ends the process."""
    guard = Guard(target)
    failure = guard.run(data)
    if failure is None:
        return data
    size = max(1, len(data) // 2)
    while True:
        less = _less(guard, failure.key, data, size)
        if less == data and size == 1:
            return data.rstrip(b"\0")
        data, size = less, max(1, size // 2)


def _less(guard: Guard, key: str, data: bytes, size: int) -> bytes:
    """Pieces of `size` left out, or set to 0, as long as the same failure remains."""
    at = 0
    while at < len(data):
        piece = data[at : at + size]
        for less in (data[:at] + data[at + size :], data[:at] + bytes(len(piece)) + data[at + size :]):
            again = guard.run(less) if less != data else None
            if again is not None and again.key == key:
                data = less
                break
        at += size
    return data
