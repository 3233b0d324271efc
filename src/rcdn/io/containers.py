"""Whether a video file was cut short: the lengths of the parts of AVI (RIFF) and MP4 or MOV (ISO 14496-12) files."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

_HEADER = 16  # bytes of a part's header, at most
_MOST = 10_000  # parts that are looked at
_UNKNOWN = (0, 0xFFFFFFFF)  # lengths in a header that its writer never filled in


def cut_short(path: str | Path) -> bool:
    """Whether the last part of the AVI, MP4 or MOV file `path` is longer than what is there of it.

    False for other formats and where the length isn't stated, as in a recording whose end was never written.
    """
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        riff = file.read(4) == b"RIFF"
        at = 0
        for _ in range(_MOST):
            if at >= size:
                break
            file.seek(at)
            length = (_riff_length if riff else _box_length)(file)
            if length == 0:
                return False
            at += length
    return at > size + (1 if riff else 0)  # the byte that pads an odd part may be missing


def _riff_length(file: BinaryIO) -> int:
    """Bytes of the part that begins here, its header included; 0 if unknown."""
    head = file.read(8)
    if len(head) < 8 or head[:4] != b"RIFF":
        return 0
    (length,) = struct.unpack_from("<I", head, 4)
    return 0 if length in _UNKNOWN else 8 + length + length % 2


def _box_length(file: BinaryIO) -> int:
    """The same of a box, whose type is four letters."""
    head = file.read(_HEADER)
    if len(head) < 8 or not head[4:8].isalnum():
        return 0
    (length,) = struct.unpack_from(">I", head)
    if length == 1 and len(head) == _HEADER:
        (length,) = struct.unpack_from(">Q", head, 8)
    return int(length) if length >= 8 else 0
