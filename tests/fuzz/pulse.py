"""What a worker is at, in memory that its parent can read after it died: how many inputs, since when,
and the bytes of the last."""

from __future__ import annotations

import mmap
import struct
import time
from pathlib import Path

ROOM = 4096
"""bytes of an engine's data that count"""
_HEAD = struct.Struct("<QdQ")


class Pulse:
    """A file in memory, shared by two processes."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(_HEAD.size + ROOM))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _HEAD.size + ROOM)

    def beat(self, count: int, data: bytes) -> None:
        """The input number `count` begins."""
        self._map[_HEAD.size : _HEAD.size + len(data)] = data
        _HEAD.pack_into(self._map, 0, count, time.monotonic(), len(data))

    def read(self) -> tuple[int, float, bytes]:
        """Number of the input, when it began (0: none has), its bytes."""
        count, since, size = _HEAD.unpack_from(self._map, 0)
        return count, since, bytes(self._map[_HEAD.size : _HEAD.size + size])
