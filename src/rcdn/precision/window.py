"""The window of each corner of a board: its pixels with their board coordinates, the input of the fit's kernels.

A corner's window is a parallelogram in its affine frame: half a square to each side, so that windows of neighbours
touch but share no pixel and their errors are independent; at most 30 px along an edge, because further out the error of
the edge's modelled course outweighs the information of its pixels; less where it would extend beyond the board's
outermost squares. Only the pixels within a band along either edge are used: more than 4 blurs + 3 px away they carry no
information.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry.median import median
from rcdn.native import bind, constants
from rcdn.precision.lattice import Lattice, Maps
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real, Shaped

FRAME, REACH, CENTRE, THIN, MIDDLE = (constants("fit")[name] for name in ("FRAME", "REACH", "CENTRE", "THIN", "MIDDLE"))
"""count of numbers that describe a window, see `frames`; indices of its half extents, its centre, its subsampling
factor, and the middle of its extents"""
FULL = constants("fit")["MOST"]
"""largest number of pixels in a window"""

_frames, _windows = bind("rcdn_fit_frames", Maps), bind("rcdn_fit_windows", Maps)


@dataclass(frozen=True, eq=False)
class Windows:
    """The pixels of N corners, P per corner, float32, as the kernels use them.

    `spot` (2, N, P): position, px from `centre` (N, 2); `value` (N, P) grey levels; `u`, `v` (N, P) squares from the
    corner; `gu`, `gv` (N, P) lengths of their gradients, squares per px; `mask` (N, P) bool: False where a corner has
    fewer pixels.
    """

    centre: Array
    spot: Array
    value: Array
    u: Array
    v: Array
    gu: Array
    gv: Array
    mask: Array


def frames(
    maps: Lattice,
    xy: Real[Array, "n 2"],
    rim: Bool[Array, "n 2"],
    blur: float,
    most: float = np.inf,
    ends: Real[Array, "n 4"] | None = None,
) -> Array:
    """Windows (N, FRAME) of the corners of a board at `xy` (N, 2) px: affine map (4), half extents (2) and bands (2),
    squares; centre (2) and half size (2) of a bounding box of the window, px; subsampling factor; middle (2) of the
    extents, squares.

    `rim` (N, 2) bool: the corner has no neighbour on one side along u, v. `blur` px, about that of the picture. If
    windows usually have more than `most` pixels, only every second, third, … pixel is used. `ends` (N, 4): distance
    towards −u, +u, −v, +v, squares, beyond which pixels are excluded. Raises LinAlgError where a map is singular.
    """
    out = np.empty((len(xy), FRAME))
    if _frames(maps.maps, np.ascontiguousarray(xy), rim.view(np.uint8), blur, out):
        raise np.linalg.LinAlgError("a map folds on a corner")
    if ends is not None:
        _cut(out, ends)
    out[:, THIN] = max(1, round(median(out[:, THIN]) / most))
    return out


def _cut(frame: Array, ends: Real[Array, "n 4"]) -> None:
    """Clip windows `frame` (N, FRAME), in place, at `ends` (N, 4)."""
    for k in (0, 1):
        reach = frame[:, REACH + k].copy()
        low, high = (np.minimum(ends[:, 2 * k + side], reach) for side in (0, 1))
        frame[:, REACH + k], frame[:, MIDDLE + k] = (high + low) / 2, (high - low) / 2
        frame[:, THIN] *= frame[:, REACH + k] / reach  # approximately, as the number of pixels changes


def windows(grey: Shaped[Array, "h w"], maps: Lattice, frame: Array) -> Windows:
    """The pixels of `grey` (H, W) in the windows `frame` (N, FRAME), with board coordinates by `maps`. `mask` is False
    outside the picture."""
    count, out = np.empty(len(frame), np.int64), np.zeros((8, len(frame), FULL), np.float32)
    _windows(grey, maps.maps, frame, count, out)
    x, y, value, u, v, gu, gv, mask = out[..., : max(int(count.max(initial=0)), 1)]
    return Windows(frame[:, CENTRE : CENTRE + 2].astype(np.int64), np.stack([x, y]), value, u, v, gu, gv, mask > 0)
