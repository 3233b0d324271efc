"""Whether a video file was cut short: the lengths of the parts with frames in AVI (RIFF) and in MP4 or MOV (ISO
14496-12) files."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_MOST = 100_000  # parts that are looked at
_UNKNOWN = (0, 0xFFFFFFFF)  # lengths in a header of AVI that its writer never filled in
_FIRST = (b"ftyp", b"moov", b"mdat", b"moof", b"free", b"skip", b"wide", b"pnot", b"styp", b"uuid")
_NEEDED = (b"movi", b"mdat", b"moof", b"moov")


def cut_short(path: str | Path) -> bool:
    """Whether a part with frames of the AVI, MP4 or MOV file `path` is longer than what is there of it.

    False for other formats, where the length isn't stated, as in a recording whose end was never written, and if only
    something behind the frames is missing.
    """
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        parts = _chunks(file) if file.read(4) == b"RIFF" else _boxes(file)
        for (kind, end), _ in zip(parts, range(_MOST), strict=False):
            if end > size:
                return kind in _NEEDED
    return False


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Kind and end of the chunks of an AVI, those inside of RIFF in its place; of lists their own kind."""
    at = 0
    while True:
        file.seek(at)
        head = file.read(12)
        if len(head) < 12:
            return
        (length,) = struct.unpack_from("<I", head, 4)
        if head[:4] == b"RIFF":
            at += 12
            continue
        if length in _UNKNOWN or not head[:4].isascii():
            return
        yield (head[8:] if head[:4] == b"LIST" else head[:4]), at + 8 + length
        at += 8 + length + length % 2


def _boxes(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Kind and end of the boxes of an MP4 or MOV; none of a file that begins as neither does."""
    at = 0
    while True:
        file.seek(at)
        head = file.read(16)
        if len(head) < 8 or (at == 0 and head[4:8] not in _FIRST):
            return
        (length,) = struct.unpack_from(">I", head)
        if length == 1 and len(head) == 16:
            (length,) = struct.unpack_from(">Q", head, 8)
        if length < 8:  # up to the end of the file, wherever that is
            return
        at += length
        yield head[4:8], at
