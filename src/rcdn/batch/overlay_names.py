"""Names of overlays: one for each picture of many folders, all in one."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

LONGEST = 180
"""Bytes of an overlay's file name without its ending; file systems take 255."""


class OverlayNames:
    """A file name for each picture's overlay: never the same for two, the folders kept as `folder__name.png`."""

    def __init__(self, paths: Sequence[Path]) -> None:
        try:
            self._root = os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
        except ValueError:  # none, or on different drives
            self._root = ""
        self._used: set[str] = set()

    def take(self, name: str) -> str:
        """The file name for the picture `name` (a path, or a video's path and frame). Call once for each."""
        full = os.path.abspath(name)
        inside = os.path.relpath(full, self._root) if self._root else full
        flat = "__".join(_safe(part) for part in Path(inside).parts if _safe(part))
        stem = flat[: -len(Path(flat).suffix)] if Path(flat).suffix and "#" not in Path(name).suffix else flat
        tries = chain((stem, flat), (f"{flat}-{k}" for k in count(2)))
        file = next(f for t in tries if (f := f"{_short(t)}.png").lower() not in self._used)
        self._used.add(file.lower())  # lower: some file systems take A.png and a.png for one
        return file


def _safe(part: str) -> str:
    """A path's part with nothing that a file system or a shell minds."""
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in part).strip("-")


def _short(stem: str) -> str:
    """At most LONGEST bytes: the end says most, and a checksum of the whole keeps it apart from others."""
    data = stem.encode("utf-8", errors="replace")
    if len(data) <= LONGEST:
        return stem
    return f"{zlib.crc32(data):08x}-{data[-LONGEST + 9 :].decode('utf-8', errors='ignore')}"
