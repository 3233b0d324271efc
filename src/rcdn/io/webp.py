"""A text in a WebP file: as the creator's tool in its XMP, which other programs replace when they save the picture."""

from __future__ import annotations

import struct
from typing import BinaryIO

_FIRST = 12  # offset of the first chunk
_MOST_CHUNKS, _MOST_BYTES = 64, 1024
_XMP, _ALPHA = 0x04, 0x10  # flags of VP8X
_PACKET = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description rdf:about="" xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmp:CreatorTool="%s"/>'
    b"</rdf:RDF></x:xmpmeta>"
)
_BEFORE, _AFTER = _PACKET.split(b"%s")


def with_tool(data: bytes, text: bytes) -> bytes:
    """A WebP file without XMP, with `text` as its creator's tool: in the extended form, which holds metadata."""
    body = data[_FIRST:] if data[_FIRST : _FIRST + 4] == b"VP8X" else _extended(data) + data[_FIRST:]
    body = body[:8] + bytes([body[8] | _XMP]) + body[9:] + _chunk(b"XMP ", _PACKET % text)  # the flags of VP8X
    return b"RIFF" + struct.pack("<I", len(body) + 4) + b"WEBP" + body


def tool(file: BinaryIO) -> bytes:
    """The text that `with_tool` wrote; b"" if there is none."""
    at = _FIRST
    for _ in range(_MOST_CHUNKS):
        file.seek(at)
        head = file.read(8)
        if len(head) < 8:
            return b""
        (size,) = struct.unpack_from("<I", head, 4)
        if head[:4] == b"XMP " and size <= _MOST_BYTES:
            packet = file.read(size)
            ours = packet.startswith(_BEFORE) and packet.endswith(_AFTER)
            return packet.removeprefix(_BEFORE).removesuffix(_AFTER) if ours else b""
        at += 8 + size + size % 2
    return b""


def _extended(data: bytes) -> bytes:
    """The chunk VP8X of a WebP file that has none: its size, and whether it has an alpha channel."""
    from rcdn.io.headers import picture_size

    width, height = picture_size(data) or (1, 1)
    alpha = data[_FIRST : _FIRST + 4] == b"VP8L" and data[24] & 0x10
    sides = ((side - 1).to_bytes(3, "little") for side in (width, height))
    return _chunk(b"VP8X", bytes([_ALPHA if alpha else 0, 0, 0, 0]) + b"".join(sides))


def _chunk(kind: bytes, content: bytes) -> bytes:
    return kind + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)
