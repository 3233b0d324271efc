"""The pixels of corners as the kernels of the last fit see them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.native import bind, constants
from rcdn.precision.lattice import Maps

CENTRE, MOST = (constants("fit")[name] for name in ("CENTRE", "MOST"))
_windows = bind("rcdn_fit_windows", Maps)


class Windows(NamedTuple):
    """The pixels of N corners, P per corner, float32, as the kernels use them.

    `spot` (2, N, P): position, px from `centre` (N, 2); `value` (N, P) grey levels; `u`, `v` (N, P) squares from the
    corner; `gu`, `gv` (N, P) lengths of their gradients, squares per px; `mask` (N, P) bool: False where a corner has
    fewer pixels.
    """

    centre: np.ndarray
    spot: np.ndarray
    value: np.ndarray
    u: np.ndarray
    v: np.ndarray
    gu: np.ndarray
    gv: np.ndarray
    mask: np.ndarray


def windows(grey, maps, frame):
    """The pixels of `grey` (H, W) in the windows `frame` (N, FRAME), with board coordinates by `maps`. `mask` is False
    outside the picture."""
    count, out = np.empty(len(frame), np.int64), np.zeros((8, len(frame), MOST), np.float32)
    _windows(grey, maps.maps, frame, count, out)
    x, y, value, u, v, gu, gv, mask = out[..., : max(int(count.max(initial=0)), 1)]
    return Windows(frame[:, CENTRE : CENTRE + 2].astype(np.int64), np.stack([x, y]), value, u, v, gu, gv, mask > 0)
