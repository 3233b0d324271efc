"""Undistortion: the pinhole camera of the undistorted picture, and the maps that resample to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rcdn.geometry.inverse import before_fold, unfolded
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.rigid import unit
from rcdn.geometry.spline_grid import folds
from rcdn.types import Array, Camera
from rcdn.types.arrays import Bool

HALF_VIEW = 55.0
"""degrees from the optical axis: limit of an undistorted picture; beyond it the perspective stretch dominates"""
NOWHERE = -1e4
"""px, value of the maps where the camera saw nothing: outside of every picture, and within cv2.remap's 16 bits"""
BLOCK = 1 << 18
"""pixels processed at a time, which bounds the memory"""


def undistorted_camera(camera: Camera) -> Camera:
    """A pinhole camera of the same size, with square pixels, that shows the row and the column through the principal
    point up to the picture's edges, but at most HALF_VIEW from the optical axis; with a barrel distortion its corners
    are not empty."""
    width, height = camera.image_size
    cx, cy = camera.K[:2, 2]
    ends = np.array([[-0.5, cy], [width - 0.5, cy], [cx, -0.5], [cx, height - 0.5]])
    rays = unproject(camera, ends)
    most = np.tan(np.radians(HALF_VIEW))
    outward = rays[[0, 1, 2, 3], [0, 0, 1, 1]] * [-1, 1, -1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] > 0, outward / rays[:, 2], np.inf)
    reach = np.clip(np.where(np.isfinite(reach), reach, most), -most, most)  # < 0: the axis lies beyond that edge
    for near, far in ((0, 1), (2, 3)):
        if not reach[near] + reach[far] > 1e-6:
            reach[[near, far]] = most
    f = max(width / (reach[0] + reach[1]), height / (reach[2] + reach[3]))
    centre = [width * reach[0] / (reach[0] + reach[1]) - 0.5, height * reach[2] / (reach[2] + reach[3]) - 0.5]
    K = np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1]])
    return Camera(K, np.zeros(0), camera.image_size, "pinhole")


def undistortion_maps(camera: Camera, flat: Camera, R: Array | None = None) -> tuple[Array, Array]:
    """Position in the picture of `camera` of each pixel of `flat`, which is rotated by `R` (3, 3; takes camera axes to
    those of `flat`): map_x and map_y (H, W) float32, px, as cv2.remap takes them; NOWHERE for pixels that `camera`
    doesn't see."""
    width, height = flat.image_size
    rows = max(BLOCK // width, 1)
    sees = ray_test(camera)
    parts = [_block(camera, flat, R, sees, y, min(y + rows, height)) for y in range(0, height, rows)]
    at = np.concatenate(parts)
    return np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])


def ray_test(camera: Camera) -> Callable[[Camera, Array], Array]:
    """The visibility test for cameras like this one: a function of a camera and rays (..., 3) that returns (...,) bool,
    whether a ray's pixel really sees this ray."""
    if camera.correction is None:
        return _reached
    return unfolded if folds(camera) else before_fold


def _block(
    camera: Camera, flat: Camera, R: Array | None, sees: Callable[[Camera, Array], Array], top: int, bottom: int
) -> Array:
    """Rows `top` to `bottom` of the maps, (rows, W, 2) float32."""
    x, y = np.arange(flat.image_size[0], dtype=float), np.arange(top, bottom, dtype=float)
    rays = unproject(flat, np.stack(np.meshgrid(x, y), axis=-1))
    rays = rays if R is None else rays @ R
    return np.where(sees(camera, rays)[..., None], project(camera, rays), NOWHERE).astype(np.float32)


def _reached(camera: Camera, rays: Array) -> Bool[Array, " ..."]:
    """(...,) bool: whether the pixels of rays (..., 3) unproject to these rays; beyond the fold they give others."""
    gap = np.linalg.norm(unit(unproject(camera, project(camera, rays))) - unit(rays), axis=-1)
    return np.asarray(gap < 1e-6)
