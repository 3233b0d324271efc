"""Square windows around many pixels at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Shaped

CHUNK = 1 << 20
"""Pixels gathered at once by the functions that gather windows: bounds the memory for any number of corners."""


def plain(grey: Shaped[Array, "h w"]) -> Array:
    """`grey` (H, W) in the form that the kernels read: contiguous, uint8 unchanged, any other type as float32. Copied
    only if needed."""
    return np.ascontiguousarray(grey, np.uint8 if grey.dtype == np.uint8 else np.float32)


def gather(image: Shaped[Array, "h w"], centres: Shaped[Array, "n 2"], half: int) -> Array:
    """Windows of `image` (H, W) around `centres` (N, 2) integer (x, y), with the border pixels repeated outside.

    Returns (N, 2 half + 1, 2 half + 1), rows first, in the image's dtype. Centres may lie outside the image.
    """
    reach = np.arange(-half, half + 1)
    height, width = image.shape
    cols = np.clip(centres[:, 0, None] + reach, 0, width - 1)
    rows = np.clip(centres[:, 1, None] + reach, 0, height - 1)
    return image[rows[:, :, None], cols[:, None, :]]


def gather_zero(image: Array, centres: Array, half: int) -> Array:
    """As `gather`, with zeros outside the image."""
    reach = np.arange(-half, half + 1)
    height, width = image.shape
    cols, rows = centres[:, 0, None] + reach, centres[:, 1, None] + reach
    inside = ((rows >= 0) & (rows < height))[:, :, None] & ((cols >= 0) & (cols < width))[:, None, :]
    return np.where(inside, gather(image, centres, half), 0)


def chunks(count: int, pixels: int) -> Iterator[slice]:
    """Slices of 0..count whose windows of `pixels` pixels each stay within `CHUNK`."""
    step = max(1, CHUNK // pixels)
    for start in range(0, count, step):
        yield slice(start, min(start + step, count))
