"""Texts that mark pictures derived by rcdn from others, so that they are never taken for photographs."""

from __future__ import annotations

import re
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Literal, get_args

from rcdn.io import jp2, tiff, webp

Mark = Literal["rcdn overlay", "rcdn undistorted"]

MARKED_ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".jp2", ".bmp", ".pgm", ".ppm"})
"""endings of files that may contain a mark"""

_HEAD = 512
"""number of bytes from the beginning within which a comment lies"""
_PNG, _IHDR_END = b"\x89PNG\r\n\x1a\n", 33
_SOI, _APP0, _COM = b"\xff\xd8", b"\xff\xe0", b"\xff\xfe"
_TIFF = re.compile(rb"II[*+]\0|MM\0[*+]")
_WEBP = re.compile(rb"RIFF....WEBP", re.DOTALL)
_PNM = re.compile(rb"P[1-6]\n")
_BMP = b"BM"


def marked(data: bytes, mark: Mark) -> bytes:
    """The bytes of a picture with `mark`: as the first comment of a PNG, a JPEG, a PGM or a PPM, as the software of a
    TIFF or a WebP, in a box of a JPEG 2000 file, after the pixels of a BMP. Those of any other file unchanged."""
    text = mark.encode("ascii")
    if data.startswith(_PNG):
        chunk = b"tEXt" + b"Comment\0" + text
        piece = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return data[:_IHDR_END] + piece + data[_IHDR_END:]
    if data.startswith(_SOI):
        at = _jpeg_place(data)
        return data[:at] + _COM + struct.pack(">H", len(text) + 2) + text + data[at:]
    if _TIFF.match(data):
        return tiff.with_software(data, text)
    if _WEBP.match(data):
        return webp.with_tool(data, text)
    if data.startswith(jp2.SIGNATURE):
        return jp2.with_text(data, text)
    if magic := _PNM.match(data):
        return magic[0] + b"# " + text + b"\n" + data[magic.end() :]
    if _is_bmp(data, len(data)):
        return data[:2] + struct.pack("<I", len(data) + len(text)) + data[6:] + text
    return data


def mark_of(path: str | Path) -> Mark | None:
    """The mark of a file, or None if it isn't a readable picture with a mark. Only a few of its bytes are read."""
    try:
        with open(path, "rb") as file:
            return _mark(file)
    except OSError:
        return None


def mark_in(data: bytes) -> Mark | None:
    """As `mark_of`, given the bytes of a file; of a PNG, a JPEG, a PGM or a PPM its first bytes will do."""
    return _mark(BytesIO(data))


def _mark(file: BinaryIO) -> Mark | None:
    text = _text(file)
    return next((mark for mark in get_args(Mark) if text == mark.encode("ascii")), None)


def _text(file: BinaryIO) -> bytes:
    """The text at the place where `marked` writes it; b"" if there is none."""
    head = file.read(_HEAD)
    if head.startswith(_PNG) and head[_IHDR_END + 4 : _IHDR_END + 8] == b"tEXt":
        start = _IHDR_END + 8
        return head[start : start + int.from_bytes(head[start - 8 : start - 4], "big")].removeprefix(b"Comment\0")
    if head.startswith(_SOI) and head[(at := _jpeg_place(head)) :].startswith(_COM):
        return head[at + 4 : at + 2 + int.from_bytes(head[at + 2 : at + 4], "big")]
    if _TIFF.match(head):
        return tiff.software(file)
    if _WEBP.match(head):
        return webp.tool(file)
    if head.startswith(jp2.SIGNATURE):
        return jp2.text(file)
    if magic := _PNM.match(head):
        first = head[magic.end() :].partition(b"\n")[0]
        return first.removeprefix(b"# ") if first.startswith(b"# ") else b""
    return _bmp_text(file, head) if head.startswith(_BMP) else b""


def _jpeg_place(data: bytes) -> int:
    """The position of the first comment of a JPEG: after the JFIF segment, which must be first."""
    at = len(_SOI)
    return at + 2 + int.from_bytes(data[at + 2 : at + 4], "big") if data[at : at + 2] == _APP0 else at


def _is_bmp(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes is a BMP that states this size."""
    return head.startswith(_BMP) and len(head) >= 26 and int.from_bytes(head[2:6], "little") == size


def _bmp_text(file: BinaryIO, head: bytes) -> bytes:
    """The mark at the end of a BMP."""
    size = file.seek(0, 2)
    if not _is_bmp(head, size):
        return b""
    for mark in get_args(Mark):
        file.seek(max(size - len(mark), 0))
        if (text := file.read()) == mark.encode("ascii"):
            return text
    return b""
