"""Which corner is (0, 0): the ordering contract of docs/conventions.md."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array, Orientation


def orientation(cols: int, rows: int) -> Orientation:
    """What colours say of a board of `cols` × `rows` inner corners.

    cols + rows odd: one labelling only. Even: half a turn looks the same; a square of an even size looks the same after quarter turns too.
    """
    if (cols + rows) % 2:
        return "unique"
    return "ambiguous_90" if cols == rows and cols % 2 == 0 else "ambiguous_180"


def turned(ij: Array, quarters: int) -> Array:
    """Labels after `quarters` quarter turns that keep the grid right-handed, starting at 0."""
    u, v = ij.T
    for _ in range(quarters % 4):
        u, v = -v, u
    out = np.stack([u, v], axis=1)
    return np.asarray(out - out.min(axis=0))


def ordered(ij: Array, xy: Array, colour: int) -> Array:
    """Labels (M, 2) that obey the contract, from right-handed labels `ij` of corners at `xy`.

    `colour`: +1 if the square between (0, 0) and (1, 1) of `ij`'s lattice (that is, of even u + v) is bright, −1 dark.
    An unambiguous board (cols + rows odd) is labelled by what is printed on it: columns along its longer side, and the square
    inside the origin is dark, so that the same printed corner has the same label from every side. Any other is labelled by how
    it lies: columns closest to +x, origin at the top left.
    """
    options = [turned(ij, k) for k in range(4)]
    cols, rows = options[0].max(axis=0) + 1
    if orientation(int(cols), int(rows)) == "unique":
        for k, option in enumerate(options):
            size = option.max(axis=0) + 1
            if size[0] > size[1] and _inside_colour(ij, k, colour) < 0:
                return option
    return max(options, key=lambda o: _rightward(o, xy))


def _inside_colour(ij: Array, quarters: int, colour: int) -> int:
    """Colour of the square between (0, 0) and (1, 1) after a turn."""
    lattice = np.stack(
        np.meshgrid(*(np.arange(lo, hi) for lo, hi in zip(ij.min(axis=0), ij.max(axis=0), strict=True))), -1
    ).reshape(-1, 2)
    middle = 2 * lattice + 1  # squares' centres, doubled
    both = np.concatenate([2 * ij, middle])
    u, v = both.T
    for _ in range(quarters % 4):
        u, v = -v, u
    new = np.stack([u, v], axis=1)
    new = new - new[: len(ij)].min(axis=0)
    first = lattice[np.flatnonzero((new[len(ij) :] == 1).all(axis=1))[0]]
    return colour * (-1) ** int(first.sum())


def _rightward(ij: Array, xy: Array) -> float:
    """cos of the angle between the column direction and +x."""
    design = np.column_stack([ij, np.ones(len(ij))])
    step = np.linalg.lstsq(design, xy, rcond=None)[0][0]
    return float(step[0] / max(np.hypot(*step), 1e-12))
