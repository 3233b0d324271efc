"""Comments that mark pictures derived by rcdn from others, so that they are never taken for photographs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Literal, get_args

Mark = Literal["rcdn overlay", "rcdn undistorted"]

_HEAD = 512
"""number of bytes from the beginning within which the comment lies"""
_PNG, _IHDR_END = b"\x89PNG\r\n\x1a\n", 33
_SOI, _APP0, _COM = b"\xff\xd8", b"\xff\xe0", b"\xff\xfe"


def marked(data: bytes, mark: Mark) -> bytes:
    """The bytes of a PNG or JPEG with `mark` as its first comment; those of any other file unchanged."""
    text = mark.encode("ascii")
    if data.startswith(_PNG):
        chunk = b"tEXt" + b"Comment\0" + text
        piece = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return data[:_IHDR_END] + piece + data[_IHDR_END:]
    if data.startswith(_SOI):
        at = _jpeg_place(data)
        return data[:at] + _COM + struct.pack(">H", len(text) + 2) + text + data[at:]
    return data


def mark_of(path: str | Path) -> Mark | None:
    """The mark of a file, or None if it isn't a readable PNG or JPEG with a mark. Only its first bytes are read."""
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return None
    return mark_in(head)


def mark_in(head: bytes) -> Mark | None:
    """As `mark_of`, given the first bytes of a file."""
    text = _first_comment(head)
    return next((mark for mark in get_args(Mark) if text == mark.encode("ascii")), None)


def _first_comment(head: bytes) -> bytes:
    """The comment at the position where `marked` writes it; b"" if there is none."""
    if head.startswith(_PNG) and head[_IHDR_END + 4 : _IHDR_END + 8] == b"tEXt":
        start = _IHDR_END + 8
        return head[start : start + int.from_bytes(head[start - 8 : start - 4], "big")].removeprefix(b"Comment\0")
    if head.startswith(_SOI) and head[(at := _jpeg_place(head)) :].startswith(_COM):
        return head[at + 4 : at + 2 + int.from_bytes(head[at + 2 : at + 4], "big")]
    return b""


def _jpeg_place(data: bytes) -> int:
    """The position of the first comment of a JPEG: after the JFIF segment, which must be first."""
    at = len(_SOI)
    return at + 2 + int.from_bytes(data[at + 2 : at + 4], "big") if data[at : at + 2] == _APP0 else at
