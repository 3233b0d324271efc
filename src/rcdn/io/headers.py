"""Format and size of a picture file from its header, before a decoder allocates memory."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator

from rcdn.io import heic, jpeg, tiff

Size = tuple[int, int]
"""(width, height)"""

_PNM = re.compile(rb"P[1-6Ff](?:\s|#[^\n]*\n)+(\d{1,10})(?:\s|#[^\n]*\n)+(\d{1,10})\s")
_PAM = [re.compile(rb"\n" + name + rb"\s+(\d{1,10})\s") for name in (b"WIDTH", b"HEIGHT")]
_HDR = re.compile(rb"\n[-+]([XY]) (\d{1,10}) [-+]([XY]) (\d{1,10})\n")


def picture_size(data: bytes) -> Size | None:
    """(width, height) px as stated in the header of a picture; None if the format isn't supported, or the header is
    damaged.

    This is the size that a decoder would allocate: of a TIFF or GIF the first page or frame, of an animation its
    canvas.
    """
    read = _reader(data)
    try:
        size = read(data) if read else None
    except (struct.error, IndexError):  # the data end within the header
        return None
    return size if size and min(size) > 0 else None


def known(head: bytes) -> bool:
    """Whether a file that begins with `head` (at least 16 bytes) has a supported format."""
    return _reader(head) is not None


def _reader(data: bytes) -> Callable[[bytes], Size | None] | None:
    return next((read for magic, read in _READERS if magic.match(data)), None)


def _png(data: bytes) -> Size | None:
    return struct.unpack_from(">II", data, 16) if data[12:16] == b"IHDR" else None


def _jpeg(data: bytes) -> Size | None:
    found = jpeg.frame(data)
    return found[:2] if found else None


def _bmp(data: bytes) -> Size:
    if struct.unpack_from("<I", data, 14)[0] == 12:
        return struct.unpack_from("<HH", data, 18)
    width, height = struct.unpack_from("<ii", data, 18)
    return abs(width), abs(height)  # a negative height: rows from the top


def _gif(data: bytes) -> Size:
    return struct.unpack_from("<HH", data, 6)


def _sun(data: bytes) -> Size:
    return struct.unpack_from(">II", data, 4)


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        bits = struct.unpack_from("<I", data, 21)[0]
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


def _pnm(data: bytes) -> Size | None:
    found = _PNM.match(data[:65536])
    return (int(found[1]), int(found[2])) if found else None


def _pam(data: bytes) -> Size | None:
    width, height = (side.search(data[:4096]) for side in _PAM)
    return (int(width[1]), int(height[1])) if width and height else None


def _hdr(data: bytes) -> Size | None:
    found = _HDR.search(data[:4096])
    if not found or found[1] == found[3]:
        return None
    sides = {found[1]: int(found[2]), found[3]: int(found[4])}
    return sides[b"X"], sides[b"Y"]


def _tiff(data: bytes) -> Size:
    tags = tiff.tags(data)
    return max(tags.get(tiff.WIDTH, [0])), max(tags.get(tiff.HEIGHT, [0]))


def _jp2(data: bytes) -> Size | None:
    """The size stated in the codestream; the header box before it may state any other size."""
    for kind, start, _ in _boxes(data):
        if kind == b"jp2c":
            return _codestream(data[start : start + 64])
    return None


def _codestream(data: bytes) -> Size | None:
    if data[:4] != b"\xff\x4f\xff\x51":  # start of codestream (SOC), followed by the size (SIZ)
        return None
    width, height, left, top = struct.unpack_from(">IIII", data, 8)
    return width - left, height - top


def _avif(data: bytes) -> Size | None:
    """Of an AVIF or a HEIC: the largest of the sizes of all items, whichever of them is decoded."""
    meta = next((data[start:end] for kind, start, end in _boxes(data) if kind == b"meta"), b"")
    sizes = [struct.unpack_from(">II", meta, m.end() + 4) for m in re.finditer(b"ispe", meta)]
    return max(sizes, key=lambda s: s[0] * s[1], default=None)


def _boxes(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """(kind, start, end) of the contents of the boxes of a JP2 or an AVIF."""
    pos = 0
    while pos + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, pos)
        start = pos + 8
        if size == 1:
            size = struct.unpack_from(">Q", data, start)[0]
            start += 8
        end = len(data) if size == 0 else pos + size
        if end < start:
            return
        yield kind, start, end
        pos = end


_READERS: list[tuple[re.Pattern[bytes], Callable[[bytes], Size | None]]] = [
    (re.compile(magic, re.DOTALL), read)
    for magic, read in (
        (rb"\x89PNG\r\n\x1a\n", _png),
        (rb"\xff\xd8\xff", _jpeg),
        (rb"BM", _bmp),
        (rb"II[*+]\0|MM\0[*+]", _tiff),
        (rb"RIFF....WEBP", _webp),
        (rb"P[1-6Ff]\s", _pnm),
        (rb"P7\n", _pam),
        (rb"\0\0\0\x0cjP  \r\n\x87\n", _jp2),
        (rb"\xff\x4f\xff\x51", _codestream),
        (rb"GIF8[79]a", _gif),
        (rb"#\?R(ADIANC|GB)E", _hdr),
        (rb"\x59\xa6\x6a\x95", _sun),
        (rb"....ftyp(avi[fs]|" + heic.BRANDS + rb")", _avif),
    )
]
