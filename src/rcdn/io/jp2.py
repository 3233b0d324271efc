"""A text in a JPEG 2000 file (ISO 15444-1): as XML in a box before the codestream."""

from __future__ import annotations

import struct
from typing import BinaryIO

SIGNATURE = b"\0\0\0\x0cjP  \r\n\x87\n"
_MOST_BOXES, _MOST_BYTES = 64, 1024
_BEFORE, _AFTER = b'<?xml version="1.0"?>\n<software>', b"</software>\n"


def with_text(data: bytes, text: bytes) -> bytes:
    """A JP2 file with `text`; unchanged if it has no codestream."""
    at = 0
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"jp2c":
            content = _BEFORE + text + _AFTER
            return data[:at] + struct.pack(">I4s", len(content) + 8, b"xml ") + content + data[at:]
        if size < 8:
            break
        at += size
    return data


def text(file: BinaryIO) -> bytes:
    """The text that `with_text` wrote; b"" if there is none."""
    at = 0
    for _ in range(_MOST_BOXES):
        file.seek(at)
        head = file.read(8)
        if len(head) < 8:
            return b""
        size, kind = struct.unpack(">I4s", head)
        if kind == b"xml " and 8 <= size <= _MOST_BYTES:
            content = file.read(size - 8)
            if content.startswith(_BEFORE) and content.endswith(_AFTER):
                return content.removeprefix(_BEFORE).removesuffix(_AFTER)
        if kind == b"jp2c" or size < 8:
            return b""
        at += size
    return b""
