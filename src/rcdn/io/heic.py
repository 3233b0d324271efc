"""HEIC and HEIF pictures, as iPhones store them, decoded by pi-heif or pillow-heif if one is installed."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ImageError
from rcdn.types import Array

BRANDS = rb"hei[cxms]|hev[cx]|mif1|msf1"
"""pattern of the major brands of these files"""
_BRAND = re.compile(rb"....ftyp(" + BRANDS + rb")", re.DOTALL)
_DAMAGE = (ValueError, RuntimeError, EOFError, OSError, SyntaxError)  # of both libraries


def is_heic(data: bytes) -> bool:
    """Whether a file that begins with `data` is HEIC or HEIF."""
    return _BRAND.match(data) is not None


def decode(data: bytes, path: str | Path) -> Array:
    """The pixels (H, W) or (H, W, 3) or (H, W, 4) BGR, uint8 or uint16, of the primary picture of a file, as the sensor
    has them: a rotation that the file asks for is undone, so that upright and lying pictures are of one camera.

    Raises ImageError if no library is installed, or if the file is damaged.
    """
    try:
        found = _library(path).open_heif(data, convert_hdr_to_8bit=False, bgr_mode=True)
        pixels = np.array(found)  # a copy: the library's memory goes with `found`
    except _DAMAGE as error:
        raise ImageError(f"{path}: damaged: {str(error).strip()}; copy it again") from error
    return np.ascontiguousarray(np.rot90(pixels, -_quarter_turns(data)))


def _library(path: str | Path) -> Any:
    for name in ("pi_heif", "pillow_heif"):
        try:
            return import_module(name)
        except ImportError:
            continue
    raise ImageError(f"{path}: HEIC pictures need a decoder: pip install 'rcdn[heic]'; or convert it to JPEG")


def _quarter_turns(data: bytes) -> int:
    """Number of counterclockwise quarter turns that decoders apply (ISO/IEC 23008-12, ImageRotation); 0 if the picture
    is mirrored, too, or if the pictures of the file are turned differently."""
    turns = set(re.findall(rb"\0\0\0\x09irot(.)", data, re.DOTALL))
    return turns.pop()[0] & 3 if len(turns) == 1 and b"\0\0\0\x09imir" not in data else 0
