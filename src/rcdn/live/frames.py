"""Decoding of frames from the page, validated before they are decoded, and encoding of pictures for the page."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import simplejpeg

from rcdn.errors import ImageError
from rcdn.types import Array

MOST_BYTES = 6_000_000
"""largest size of one frame, bytes"""
SIDES = (120, 4096)
"""px: smallest shorter and largest longer side of a frame"""
THUMB, PREVIEW = 320, 960
"""px: widths of pictures for the page"""


def decoded(data: bytes) -> Array:
    """A JPEG as grey (H, W) uint8. Its size is checked before its pixels are decoded. Raises ImageError for anything
    that isn't a JPEG, is damaged, too small or too large."""
    if len(data) > MOST_BYTES:
        raise ImageError(f"a frame has {len(data)} bytes, more than {MOST_BYTES}")
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(data)
        check_sides(width, height)
        grey = simplejpeg.decode_jpeg(data, "GRAY")
    except (ValueError, RuntimeError, MemoryError) as error:
        raise ImageError(f"a frame is no JPEG that can be decoded ({error})") from error
    return np.ascontiguousarray(grey[:, :, 0])


def check_sides(width: int, height: int) -> None:
    """Raise ImageError unless frames of this size are accepted."""
    if min(width, height) < SIDES[0] or max(width, height) > SIDES[1]:
        raise ImageError(f"a frame has {width}×{height} px; its sides must be {SIDES[0]} to {SIDES[1]} px")


def encoded(picture: Array, width: int, quality: int = 75) -> bytes:
    """A picture (H, W) or (H, W, 3) BGR uint8 as a JPEG at most `width` px wide."""
    scale = width / picture.shape[1]
    if scale < 1:
        height = max(1, round(picture.shape[0] * scale))
        picture = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def side_by_side(pictures: Sequence[Array], width: int) -> bytes:
    """Pictures (H, W) uint8 as one JPEG, each at most `width` px wide and as high as the first."""
    height = pictures[0].shape[0]
    level = [p if p.shape[0] == height else _as_high(p, height) for p in pictures]
    return encoded(np.hstack(level), width * len(level))


def _as_high(picture: Array, height: int) -> Array:
    width = max(1, round(picture.shape[1] * height / picture.shape[0]))
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
