"""Imperfect boards: printed slightly too long in one direction, with a smooth error in the plane, and bent."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn_lab.camera_scenes import SIZE, SPACING, labels

WAVES = 4
"""number of cosines whose sum is a smooth error"""
FREQUENCIES = (0.5, 2.5)
"""rad per half of the board's longer side"""


def smooth_error(rng: np.random.Generator, rms: float, size: tuple[int, int] = SIZE) -> Array:
    """(N,) a random smooth function over the corners of a board of `size`, without its constant and linear parts, of
    root mean square `rms`.

    A sum of cosines of random directions, not the polynomials that a calibration estimates.
    """
    centred = labels(size) - (np.array(size) - 1) / 2
    places = 2 * centred / (max(size) - 1)
    angle = rng.uniform(0, 2 * np.pi, WAVES)
    waves = np.stack([np.cos(angle), np.sin(angle)]) * rng.uniform(*FREQUENCIES, WAVES)
    values = np.cos(places @ waves + rng.uniform(0, 2 * np.pi, WAVES)) @ rng.normal(size=WAVES)
    slopes = np.column_stack([np.ones(len(places)), places])
    values = values - slopes @ np.linalg.lstsq(slopes, values, rcond=None)[0]
    return np.asarray(values * rms / np.sqrt((values**2).mean()))


def curved_board(depth: Array | tuple[float, float], size: tuple[int, int] = SIZE) -> Array:
    """(N, 3) m: displacements of the corners of a paraboloid whose centre is raised by `depth` (2,) m along the board's
    columns and rows."""
    u = labels(size) / (np.array(size) - 1) * 2 - 1
    out = (1 - u**2) @ np.asarray(depth, float)
    return np.column_stack([0 * out, 0 * out, out])


def uneven_board(
    rng: np.random.Generator, stretch: float, print_error: float, bend: float, size: tuple[int, int] = SIZE
) -> Array:
    """(N, 3) m: displacements of the corners of a board whose x is printed longer than its y by the share `stretch`,
    with smooth errors of root mean square `print_error` m along either axis of its plane and `bend` m out of it."""
    centred = (labels(size) - (np.array(size) - 1) / 2) * SPACING
    plane = centred * [stretch / 2, -stretch / 2]
    plane = plane + np.stack([smooth_error(rng, print_error, size) for _ in range(2)], axis=1)
    return np.column_stack([plane, smooth_error(rng, bend, size)])
