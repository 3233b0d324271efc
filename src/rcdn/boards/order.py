"""Choice of corner (0, 0): the ordering contract of docs/conventions.md."""

from __future__ import annotations

import numpy as np

from rcdn.geometry.matrices import affine
from rcdn.types import Array, Orientation
from rcdn.types.arrays import Int


def orientation(cols: int, rows: int) -> Orientation:
    """Which labellings the colours of a board of `cols` × `rows` inner corners leave open.

    cols + rows odd: a single labelling. Even: the board is symmetric under a half turn; a square of an even size under
    quarter turns, too.
    """
    if (cols + rows) % 2:
        return "unique"
    return "ambiguous_90" if cols == rows and cols % 2 == 0 else "ambiguous_180"


def turned(ij: Array, quarters: int) -> Array:
    """Labels after `quarters` quarter turns that keep the grid right-handed; the smallest labels are 0."""
    u, v = ij.T
    for _ in range(quarters % 4):
        u, v = -v, u
    out = np.stack([u, v], axis=1)
    return np.asarray(out - out.min(axis=0))


def ordered(ij: Array, xy: Array, colour: int) -> Int[Array, "m 2"]:
    """Labels (M, 2) that obey the contract, from right-handed labels `ij` of corners at `xy`.

    `colour`: +1 if the square between (0, 0) and (1, 1) of `ij`'s lattice (that is, of even u + v) is bright, −1 if
    dark. An unambiguous board (cols + rows odd) is labelled by its print: columns along its longer side, and the square
    inside the origin is dark, so that the same printed corner has the same label from every viewpoint. Any other board
    is labelled by its pose in the image: columns closest to +x, origin at the top left.
    """
    low, high = ij.min(axis=0).tolist(), ij.max(axis=0).tolist()
    cols, rows = high[0] - low[0] + 1, high[1] - low[1] + 1
    quarters = range(4)
    if orientation(cols, rows) == "unique":
        along = quarters[int(cols < rows) :: 2]  # turns after which columns run along the longer side
        squares = [(low[0], low[1]), (low[0], high[1] - 1), (high[0] - 1, high[1] - 1), (high[0] - 1, low[1])]
        for k in along:  # the square inside the origin
            if colour * (-1) ** sum(squares[k]) < 0:
                return turned(ij, k)
    rightward = _rightward(ij, xy)
    return turned(ij, max(quarters, key=lambda k: rightward[k]))


def _rightward(ij: Array, xy: Array) -> list[float]:
    """Cosine of the angle between the column direction and +x, after 0 to 3 quarter turns."""
    u, v, _ = affine(ij, xy).T
    return [float(step[0] / max(np.linalg.norm(step, axis=0), 1e-12)) for step in (u, -v, -u, v)]
