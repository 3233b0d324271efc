"""The link check: the one place where board recovery looks at pixels."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array

ALONG, ACROSS = 9, (0.08, 0.14, 0.2)
"""samples along a link, and offsets to its sides, shares of its length"""
SKIP = 0.15
"""share of the link left out at both ends, where blur mixes all four squares"""


def edge_contrast(grey: Array, start: Array, end: Array) -> Array:
    """What separates the two sides of each link, (L, 3) grey levels: one mean difference for each third of its length.

    `grey` (H, W); `start`, `end` (L, 2) px. Positive: the side at rising angle (clockwise on the screen) from the direction start → end
    is brighter. Offsets to the side stay between 1 and 5 px. Outside the image the border repeats.
    """
    if not len(start):
        return np.zeros((0, 3))
    step = end - start
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    t = np.linspace(SKIP, 1 - SKIP, ALONG)
    middle = start[:, None] + t[None, :, None] * step[:, None]
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None]
    reach = np.clip(length[:, None] * np.array(ACROSS), 1, 5)
    shift = reach[:, None, :, None] * normal[:, None, None, :]
    near, far = (_sample(grey, middle[:, :, None] + s * shift).mean(axis=2) for s in (1, -1))
    return np.asarray((near - far).reshape(len(start), 3, ALONG // 3).mean(axis=2))


def _sample(grey: Array, xy: Array) -> Array:
    """Bilinear grey levels at `xy` (..., 2)."""
    flat: Array = xy.reshape(-1, 2).astype(np.float32)
    columns = 1 << 14  # remap takes fewer than 32768 rows and columns
    pad = -len(flat) % columns
    flat = np.pad(flat, ((0, pad), (0, 0))).reshape(-1, min(columns, len(flat) + pad), 2)
    values = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.reshape(-1)[: xy.size // 2].reshape(xy.shape[:-1]), np.float64)
