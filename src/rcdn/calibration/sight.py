"""What part of the frame a lens model has rays for."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import unproject
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

WIDEST = 90.0
"""degrees off the axis; what a fisheye sees beyond is taken for the dark around its circle, and doesn't count"""
NEARLY = 80.0
"""degrees; a lens model that has rays up to here and then none has reached such a circle, too; one that ends before is broken"""
CELLS = (32, 24)
LONGER = 8
"""cells of the coverage along the frame's longer side"""


def reach(camera: Camera) -> float:
    """Share of the frame that the lens sees for which its model has rays."""
    beyond, broken = out_of_sight(camera, cell_centres(camera.image_size, CELLS))
    return float(1 - broken.sum() / max((~beyond).sum(), 1))


def cell_centres(image_size: tuple[int, int], cells: tuple[int, int]) -> Array:
    """(rows, cols, 2) px."""
    (width, height), (cols, rows) = image_size, cells
    x = (np.arange(cols) + 0.5) * width / cols - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(x, y), axis=-1)


def cells_of(image_size: tuple[int, int], longer: int = LONGER) -> tuple[int, int]:
    """(columns, rows) of nearly square cells, `longer` along the longer side."""
    width, height = image_size
    side = max(width, height) / longer
    return max(round(width / side), 2), max(round(height / side), 2)


def out_of_sight(camera: Camera, pixels: Array) -> tuple[Array, Array]:
    """Of pixels (..., 2) spread over the frame: those beyond what the lens sees, and those where its model ends too early, bool."""
    angle = off_axis(camera, pixels)
    blind = ~np.isfinite(angle)
    full = bool((angle[~blind] >= NEARLY).any())
    beyond = np.nan_to_num(angle) > WIDEST
    return beyond | (blind & full), blind & (not full)


def off_axis(camera: Camera, pixels: Array) -> Real[Array, " ..."]:
    """(...,) degrees between the axis and the ray of the pixel (..., 2); NaN without a ray."""
    rays = unproject(camera, pixels)
    return np.asarray(np.degrees(np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])))
