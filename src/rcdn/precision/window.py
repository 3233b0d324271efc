"""The window of each corner of a board: its pixels with their board coordinates, the input of the fit's kernels.

A corner's window is a parallelogram in its affine frame: half a square to each side, so that windows of neighbours
touch but share no pixel and their errors are independent; at most 30 px along an edge, because further out the error of
the edge's modelled course outweighs the information of its pixels; less where it would extend beyond the board's
outermost squares. Only the pixels within a band along either edge are used: more than 4 blurs + 3 px away they carry no
information.
"""

from __future__ import annotations

import numpy as np

from rcdn.geometry.median import median
from rcdn.native import bind, constants
from rcdn.precision.lattice import Lattice, Maps
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

FRAME, REACH, THIN, MIDDLE = (constants("fit")[name] for name in ("FRAME", "REACH", "THIN", "MIDDLE"))
"""count of numbers that describe a window, see `frames`; indices of its half extents, its subsampling factor, and the
middle of its extents"""

_frames = bind("rcdn_fit_frames", Maps)


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
