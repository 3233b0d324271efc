"""The part of the frame in which a lens model has viewing rays."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import unproject
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

WIDEST = 90.0
"""degrees from the optical axis; what a fisheye images beyond is treated as the dark surround of its image circle, and
does not count"""
NEARLY = 80.0
"""degrees; a lens model that has rays up to this angle and then none has reached such a circle, too; one that ends
before is invalid there"""
CROWDED = 0.2
"""× the change of the ray's angle along the pixel's radius that the pinhole camera has there: below it the model has a
pole near this pixel, and gives all pixels beyond it nearly the same ray. A lens with a pincushion distortion of a third
of the radius still has half"""
STEP = 0.01
"""share of its distance from the principal point by which a pixel is moved to see that change"""
CELLS = (32, 24)
LONGER = 8
"""cells of the coverage along the frame's longer side"""


def reach(camera: Camera) -> float:
    """Share of the visible part of the frame in which the lens model has rays."""
    beyond, broken = out_of_sight(camera, cell_centres(camera.image_size, CELLS))
    return float(1 - broken.sum() / max((~beyond).sum(), 1))


def cell_centres(image_size: tuple[int, int], cells: tuple[int, int]) -> Array:
    """(rows, cols, 2) px: centres of equal cells of the frame."""
    (width, height), (cols, rows) = image_size, cells
    x = (np.arange(cols) + 0.5) * width / cols - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    return np.stack(np.meshgrid(x, y), axis=-1)


def cells_of(image_size: tuple[int, int], longer: int = LONGER) -> tuple[int, int]:
    """(columns, rows) of nearly square cells, `longer` of them along the frame's longer side."""
    width, height = image_size
    side = max(width, height) / longer
    return max(round(width / side), 2), max(round(height / side), 2)


def out_of_sight(camera: Camera, pixels: Array) -> tuple[Array, Array]:
    """For `pixels` (..., 2) over the frame, bool (...): which lie outside what the lens images, and at which the lens
    model has no ray though it should."""
    angle = off_axis(camera, pixels)
    blind = ~np.isfinite(angle) | _crowded(camera, pixels, angle)
    full = bool((angle[~blind] >= NEARLY).any())
    beyond = np.nan_to_num(angle) > WIDEST
    return beyond | (blind & full), blind & (not full)


def _crowded(camera: Camera, pixels: Array, angle: Array) -> Array:
    """Bool (...): at which of the `pixels` (..., 2), seen at `angle` (...), degrees, rays hardly change outwards."""
    outwards = STEP * (pixels - camera.K[:2, 2])
    change = np.radians(off_axis(camera, pixels + outwards) - angle)
    pinhole = np.cos(np.radians(angle)) ** 2 * np.linalg.norm(outwards / np.diag(camera.K)[:2], axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray((angle < WIDEST) & (change < CROWDED * pinhole))


def off_axis(camera: Camera, pixels: Array) -> Real[Array, " ..."]:
    """(...,) angle between the optical axis and the ray of each pixel (..., 2), degrees; NaN without a ray."""
    rays = unproject(camera, pixels)
    return np.asarray(np.degrees(np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])))
