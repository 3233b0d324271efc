"""Decoding picture files: files that are too large, truncated or damaged raise an error, rather than being decoded with
missing parts filled in."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from rcdn.errors import ImageError
from rcdn.io import headers, heic, jpeg, tiff
from rcdn.io.quiet import quiet_opencv
from rcdn.limits import OPENCV, check_size
from rcdn.types import Array

# One or three channels (no alpha), every depth, and pixels as stored: not turned by an EXIF orientation.
_DECODE = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"


def decode(data: bytes, path: str | Path) -> Array:
    """The pixels (H, W), (H, W, 1) or (H, W, 3) BGR of a picture file, any depth. `path` is its name in error messages.

    Raises ImageError if it is no picture, or of an unsupported format; if it exceeds the limit on pixels; if it is
    truncated, or damaged as far as that can be detected (docs/decisions/0025-damaged-pictures.md).
    """
    size = headers.picture_size(data)
    _refuse_truncated(data, path)
    if size is None:
        raise _unreadable(path, "")
    check_size(str(path), *size)
    if heic.is_heic(data):
        return heic.decode(data, path)
    reason = ""
    if data.startswith(_JPEG):
        pixels, reason = _jpeg(data, path)
        if pixels is not None:
            return pixels
    elif data.startswith((b"II", b"MM")) and (harm := tiff.damage(data)):
        raise _damaged(path, harm)
    image = _by_opencv(tiff.as_stored(data), path)
    if image is None:
        raise _damaged(path, harm) if (harm := _png_damage(data)) else _unreadable(path, reason)
    return image


def _jpeg(data: bytes, path: str | Path) -> tuple[Array | None, str]:
    try:
        return jpeg.decode(data)
    except jpeg.DamageError as error:
        raise _damaged(path, str(error).removeprefix("Corrupt JPEG data: ")) from None


def _by_opencv(data: bytes, path: str | Path) -> Array | None:
    try:
        with quiet_opencv():
            return cv2.imdecode(np.frombuffer(data, np.uint8), _DECODE)
    except cv2.error as error:
        if "CV_IO_MAX_IMAGE" in error.err:
            raise ImageError(
                f"{path}: larger than OpenCV decodes; set {OPENCV} to its pixels before the start"
            ) from error
        raise ImageError(f"{path}: OpenCV can't decode it ({error.err}); convert it to an 8-bit PNG") from error


def _damaged(path: str | Path, reason: str) -> ImageError:
    return ImageError(f"{path}: damaged: {reason}; copy it again")


def _unreadable(path: str | Path, reason: str) -> ImageError:
    why = f" ({reason})" if reason else ""
    return ImageError(f"{path}: not a picture that can be read, or a damaged one{why}; convert it to PNG or JPEG")


def _refuse_truncated(data: bytes, path: str | Path) -> None:
    """Raise ImageError for a truncated file: decoders only warn and fill the missing part of a JPEG with grey, which
    would pass for a valid picture."""
    whole = True
    if data.startswith(_JPEG):
        whole = jpeg.is_whole(data)
    elif data.startswith(_PNG):
        whole = any(kind == b"IEND" for kind, _, _ in _chunks(data))
    if not whole:
        raise ImageError(f"{path}: the file is truncated (its end is missing); copy or export it again")


def _png_damage(data: bytes) -> str:
    """The damage of a PNG that can't be decoded: the chunk with a wrong checksum, or pixels that can't be inflated; ""
    if `data` is no PNG."""
    if not data.startswith(_PNG):
        return ""
    for kind, start, end in _chunks(data):
        if zlib.crc32(memoryview(data)[start - 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return f"the checksum of its {kind.decode('ascii', 'replace')} is wrong"
    return "its pixels can't be inflated"


def _chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """(kind, start, end) of the contents of each complete chunk of a PNG, up to IEND."""
    pos = len(_PNG)
    while pos + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, pos)
        start, end = pos + 8, pos + 8 + length
        if end + 4 > len(data):
            return
        yield kind, start, end
        if kind == b"IEND":
            return
        pos = end + 4
