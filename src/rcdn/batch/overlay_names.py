"""File names of overlays: unique names in a single folder for pictures of many folders."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

LONGEST = 180
"""The longest file name of an overlay without its ending, in bytes; file systems allow 255."""


class OverlayNames:
    """Assigns a different file name to each picture's overlay; folders become part of the name: `folder__name.png`."""

    def __init__(self, paths: Sequence[Path]) -> None:
        try:
            self._root = os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
        except ValueError:  # no paths, or on different drives
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
        self._used.add(file.lower())  # lower case: some file systems don't distinguish A.png from a.png
        return file


def _safe(part: str) -> str:
    """A part of a path with characters replaced that a file system or a shell treats specially."""
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in part).strip("-")


def _short(stem: str) -> str:
    """`stem` shortened to at most LONGEST bytes: its end, preceded by a checksum of the whole that keeps it unique."""
    data = stem.encode("utf-8", errors="replace")
    if len(data) <= LONGEST:
        return stem
    return f"{zlib.crc32(data):08x}-{data[-LONGEST + 9 :].decode('utf-8', errors='ignore')}"
