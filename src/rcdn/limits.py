"""The largest picture that is read: a file of a few hundred bytes can declare gigabytes of pixels."""

from __future__ import annotations

import os

from rcdn.errors import ConfigError, ImageError

VARIABLE = "RCDN_MAX_MEGAPIXELS"
"""environment variable, so that child processes inherit the limit"""
MEGAPIXELS = 250.0
"""the limit if the variable is not set; 10⁶ pixels"""
BYTES_A_PIXEL = 16
"""bytes of the largest file, per pixel of the largest picture: four 32-bit channels, uncompressed"""
OPENCV = "OPENCV_IO_MAX_IMAGE_PIXELS"
"""OpenCV's own limit, 2³⁰ pixels, which it reads when it is loaded"""


def max_megapixels() -> float:
    """The limit in force. Raises ConfigError if the environment variable is not a positive number."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        return MEGAPIXELS
    try:
        limit = float(text)
    except ValueError:
        limit = 0.0
    if not 0 < limit < 1e9:
        raise ConfigError(f"{VARIABLE} must be a number of megapixels above 0, not {text!r}")
    return limit


def set_max_megapixels(limit: float) -> None:
    """Let this process and its child processes read pictures of up to `limit` megapixels. Call it before OpenCV is
    imported, since OpenCV's own limit is raised with it."""
    os.environ[VARIABLE] = f"{limit:.15g}"
    if limit * 1e6 > 1 << 30:
        os.environ.setdefault(OPENCV, str(int(limit * 1e6)))


def check_size(name: str, width: int, height: int) -> None:
    """Raise ImageError if a picture or frame of that size is over the limit."""
    limit = max_megapixels()
    if width * height > limit * 1e6:
        raise ImageError(
            f"{name}: {width} × {height} px are {width * height / 1e6:.3g} megapixels, more than {limit:g}; "
            f"if that is right, allow it with --max-megapixels or {VARIABLE}"
        )


def most_bytes() -> int:
    """The size of the largest file that is read, bytes."""
    return int(max_megapixels() * 1e6) * BYTES_A_PIXEL


def too_many_bytes(name: str) -> ImageError:
    """The error for a file larger than `most_bytes`."""
    return ImageError(
        f"{name}: more than {most_bytes() / 1e9:.3g} GB, the most that pictures of {max_megapixels():g} megapixels "
        f"take; if that is right, allow it with --max-megapixels or {VARIABLE}"
    )
