"""Decoding JPEGs with a decoder that reports damaged data (simplejpeg, libjpeg-turbo); OpenCV's conceals the damage.

Reasons, and what is and isn't detected: docs/decisions/0025-damaged-pictures.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import simplejpeg

from rcdn.types import Array

# A marker that isn't a stuffed byte (FF00), a restart (FFD0..FFD7) or padding (FFFF).
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_SCAN, _END, _ALONE = 0xDA, 0xD9, 0x01
# Segments needed for decoding: tables, the frame, restart intervals, and those application segments that define colour.
_NEEDED = _FRAMES | {0xC4, 0xCC, 0xDB, 0xDC, 0xDD, _SCAN, 0xE0, 0xEE}
_SPACES = {1: "GRAY", 3: "BGR", 4: "CMYK"}
# Prefixes of libjpeg's messages on damaged data. Other errors mean a kind of JPEG that simplejpeg doesn't support.
_DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "Inconsistent progression")
_MOST_SEGMENTS = 1 << 16  # far more than pictures have


class DamageError(Exception):
    """The picture's data are damaged; the text is the decoder's message."""


def segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """(marker, start, end) of each segment up to and including the end marker; `data[start:end]` includes the marker.

    Segments are skipped by their length, since an embedded thumbnail has markers of its own. Bytes between segments are
    ignored, as decoders do."""
    pos = 2
    for _ in range(_MOST_SEGMENTS):
        if (found := _MARKER.search(data, pos)) is None:
            return
        code = data[found.end() - 1]
        size = 0 if code in (_END, _ALONE) else int.from_bytes(data[found.end() : found.end() + 2], "big")
        pos = found.end() + size
        yield code, found.start(), pos
        if code == _END:
            return


def is_whole(data: bytes) -> bool:
    """True if the end marker (EOI) is present."""
    return any(code == _END for code, _, _ in segments(data))


def frame(data: bytes) -> tuple[int, int, int] | None:
    """(width, height, components) from the frame header, or None if there is none."""
    for code, start, end in segments(data):
        if code in _FRAMES and end - start >= 10 and end <= len(data):
            height, width = (int.from_bytes(data[k : k + 2], "big") for k in (start + 5, start + 7))
            return width, height, data[start + 9]
        if code == _SCAN:
            return None
    return None


def decode(data: bytes) -> tuple[Array | None, str]:
    """The pixels (H, W, 1) or (H, W, 3) BGR of a JPEG, equal to OpenCV's; or (None, reason) for kinds that are left to
    OpenCV: CMYK, unusual chroma sampling, more than 8 bits, no picture at all. Raises DamageError if data of the
    picture are missing or wrong."""
    space = _SPACES.get((frame(data) or (0, 0, 0))[2])
    if space is None:
        return None, "no header that says what it is"
    reasons = []
    for version in (lambda: data, lambda: _tidied(data)):
        try:
            pixels = simplejpeg.decode_jpeg(version(), space)
        except (ValueError, KeyError) as error:  # KeyError: a sampling that simplejpeg has no name for
            reasons.append(str(error))
        else:
            # CMYK is left to OpenCV, since simplejpeg converts it in another way
            return (None, "CMYK") if space == "CMYK" else (pixels, "")
    if damage := next((r for r in reversed(reasons) if r.startswith(_DAMAGE)), ""):
        raise DamageError(damage)
    return None, reasons[0]


def _tidied(data: bytes) -> bytes:
    """The same picture without harmless irregularities that cameras write and a strict decoder rejects.

    Removed are bytes between segments, zero padding after a scan, and segments not needed for decoding; the JFIF
    version is set to one that libjpeg knows, and the spectral selection of a sequential scan to its standard values.
    """
    parts, sequential = [data[:2]], False
    for code, start, end in segments(data):
        segment = data[start:end]
        if code in (0xC0, 0xC1):
            sequential = True
        if code == _END:
            parts.append(segment)
        elif code == 0xE0 and segment[4:9] == b"JFIF\0":
            parts.append(segment[:9] + b"\1\1" + segment[11:])
        elif code == _SCAN:
            parts += [segment[:-3] + b"\0\x3f\0" if sequential else segment, _scan(data, end)]
        elif code in _NEEDED:
            parts.append(segment)
    return b"".join(parts)


def _scan(data: bytes, start: int) -> bytes:
    """The entropy-coded data from `start` on, without zero padding: valid data end with one bits."""
    found = _MARKER.search(data, start)
    scan = data[start : found.start() if found else len(data)]
    bare = scan.rstrip(b"\0")
    return bare + b"\0" if bare.endswith(b"\xff") and len(bare) < len(scan) else bare  # FF00 encodes the byte FF
