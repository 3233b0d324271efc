"""Parts of TIFF that OpenCV doesn't cover: the size, the orientation, the name of the software, and missing or damaged
strips."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO

WIDTH, HEIGHT, COMPRESSION, ORIENTATION = 256, 257, 259, 274
STRIPS, STRIP_BYTES, TILES, TILE_BYTES = 273, 279, 324, 325
SOFTWARE, _ASCII = 305, 2
_WANTED = frozenset({WIDTH, HEIGHT, COMPRESSION, STRIPS, STRIP_BYTES, TILES, TILE_BYTES})
_VALUES = {3: "H", 4: "I", 16: "Q"}  # integer types
_DEFLATE = ([8], [32946])
_MOST_TAGS, _MOST_TEXT = 4096, 256
_PIECE = 1 << 20  # bytes inflated at once


def tags(data: bytes) -> dict[int, list[int]]:
    """The integer values of the first page by tag: sizes and offsets; the values of a repeated tag are concatenated.
    Raises struct.error if the file is truncated."""
    order, room, entries = _directory(data)
    place, step = f"{order}{'Q' if room == 8 else 'I'}", entries.step
    found: dict[int, list[int]] = {}
    for entry in entries[:_MOST_TAGS]:
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if kind not in _VALUES or tag not in _WANTED:
            continue
        many = struct.unpack_from(place, data, entry + 4)[0]
        size = many * struct.calcsize(_VALUES[kind])
        if size > len(data):
            raise struct.error("more values than the file holds")
        value = entry + step - room
        if size > room:
            value = struct.unpack_from(place, data, value)[0]
        found.setdefault(tag, []).extend(struct.unpack_from(f"{order}{many}{_VALUES[kind]}", data, value))
    return found


def _directory(data: bytes) -> tuple[str, int, range]:
    """Byte order, bytes of a value in an entry (4, in a BigTIFF 8) and the offsets of the entries of the first page.
    Raises struct.error if the file is truncated."""
    order = "<" if data[:2] == b"II" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    place, room, step = (f"{order}Q", 8, 20) if big else (f"{order}I", 4, 12)
    at = struct.unpack_from(place, data, 8 if big else 4)[0]
    count = struct.unpack_from(place if big else f"{order}H", data, at)[0]
    first = at + (8 if big else 2)
    return order, room, range(first, first + step * count, step)


def damage(data: bytes) -> str:
    """A description of missing or damaged pixel data of the first page; "" if none is detected.

    libtiff ignores such strips. Checked are the strips' offsets and, if they are deflated, their data and checksums;
    LZW and uncompressed strips have no checksums.
    """
    try:
        found = tags(data)
    except struct.error:
        return ""  # libtiff reports the error
    places, sizes = (
        found.get(STRIPS, []) + found.get(TILES, []),
        found.get(STRIP_BYTES, []) + found.get(TILE_BYTES, []),
    )
    parts = list(zip(places, sizes, strict=False))
    if any(place + size > len(data) for place, size in parts):
        return "strips lie beyond its end"
    if found.get(COMPRESSION) in _DEFLATE:
        room = 32 * max(found.get(WIDTH, [0])) * max(found.get(HEIGHT, [0]))  # no pixel has more bytes
        return next(
            (reason for place, size in parts if (reason := _uninflatable(data[place : place + size], room))), ""
        )
    return ""


def _uninflatable(strip: bytes, room: int) -> str:
    inflater, done = zlib.decompressobj(), 0
    try:
        while strip and not inflater.eof and done <= room:
            done += len(inflater.decompress(strip, _PIECE))
            strip = inflater.unconsumed_tail
    except zlib.error as error:
        return f"a strip can't be inflated ({error})"
    return ""


def as_stored(data: bytes) -> bytes:
    """`data` with a TIFF's orientation set to "as stored": OpenCV's TIFF reader has no option to ignore it."""
    if data[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return data
    try:
        order, room, entries = _directory(data)
        for entry in entries:
            if struct.unpack_from(f"{order}H", data, entry)[0] == ORIENTATION and entry + entries.step <= len(data):
                value = entry + entries.step - room
                return data[:value] + struct.pack(f"{order}H", 1) + data[value + 2 :]
    except struct.error:
        pass  # libtiff reports the truncated file
    return data


def with_software(data: bytes, text: bytes) -> bytes:
    """A TIFF whose first page names the software `text` (8 bytes or more), by a directory of tags that is appended."""
    order, room, entries = _directory(data)
    place, many = ("Q", "Q") if room == 8 else ("I", "H")
    data += bytes(len(data) % 2)
    value = text + b"\0" * (2 - len(text) % 2)
    entry = struct.pack(f"{order}HH{place}{place}", SOFTWARE, _ASCII, len(text) + 1, len(data))
    others = [data[at : at + entries.step] for at in entries]
    all_ = sorted([entry, *(e for e in others if _tag(order, e) != SOFTWARE)], key=lambda e: _tag(order, e))
    following = data[entries.stop : entries.stop + room]  # the place of the next page
    directory = struct.pack(f"{order}{many}", len(all_)) + b"".join(all_) + following
    return data[:room] + struct.pack(f"{order}{place}", len(data) + len(value)) + data[2 * room :] + value + directory


def software(file: BinaryIO) -> bytes:
    """The software that the first page of a TIFF names; b"" if none, or if the file is damaged."""
    try:
        file.seek(0)
        head = file.read(16)
        order = "<" if head[:2] == b"II" else ">"
        place, room, step, many = ("Q", 8, 20, "Q") if head[2:4] in (b"+\0", b"\0+") else ("I", 4, 12, "H")
        file.seek(struct.unpack_from(f"{order}{place}", head, room)[0])
        (count,) = struct.unpack(f"{order}{many}", file.read(struct.calcsize(many)))
        for _ in range(min(count, _MOST_TAGS)):
            tag, kind, size, at = struct.unpack(f"{order}HH{place}{place}", file.read(step))
            if tag == SOFTWARE:
                if kind != _ASCII or not room < size <= _MOST_TEXT:
                    return b""
                file.seek(at)
                return file.read(size).rstrip(b"\0")
    except (struct.error, OSError, OverflowError, ValueError):  # offsets beyond any file
        pass
    return b""


def _tag(order: str, entry: bytes) -> int:
    return int(struct.unpack_from(f"{order}H", entry)[0])
