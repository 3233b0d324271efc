"""Pictures without distortion: the pinhole camera that they are of, and the maps that make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rcdn.geometry.inverse import before_fold, unfolded
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.spline_grid import folds
from rcdn.types import Array, Camera
from rcdn.types.arrays import Bool

HALF_VIEW = 55.0
"""degrees off the axis: how far the undistorted picture goes at most; beyond, a flat picture is nothing but stretched edges"""
NOWHERE = -1e4
"""px, the maps' value where the camera saw nothing: outside of every picture, and within cv2.remap's 16 bits"""
BLOCK = 1 << 18
"""pixels at a time, which bounds the memory"""


def undistorted_camera(camera: Camera) -> Camera:
    """A pinhole camera of the same size that shows the picture's middle lines out to its edges, but no more than HALF_VIEW off the
    axis, with square pixels and no empty corners under a barrel distortion."""
    width, height = camera.image_size
    cx, cy = camera.K[:2, 2]
    ends = np.array([[-0.5, cy], [width - 0.5, cy], [cx, -0.5], [cx, height - 0.5]])
    rays = unproject(camera, ends)
    most = np.tan(np.radians(HALF_VIEW))
    across = np.abs(rays[[0, 1, 2, 3], [0, 0, 1, 1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(rays[:, 2] > 0, across / rays[:, 2], np.inf)
    reach = np.minimum(np.where(np.isfinite(reach) & (reach > 1e-6), reach, most), most)
    f = max(width / (reach[0] + reach[1]), height / (reach[2] + reach[3]))
    centre = [width * reach[0] / (reach[0] + reach[1]) - 0.5, height * reach[2] / (reach[2] + reach[3]) - 0.5]
    K = np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1]])
    return Camera(K, np.zeros(0), camera.image_size, "pinhole")


def resized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of the same picture at another `size` (width, height); pixel centres at integers."""
    sx, sy = size[0] / camera.image_size[0], size[1] / camera.image_size[1]
    K = np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1]]) @ camera.K
    return replace(camera, K=K, image_size=size)


def undistortion_maps(camera: Camera, flat: Camera, R: Array | None = None) -> tuple[Array, Array]:
    """For each pixel of `flat`, turned by `R` (3, 3; takes camera axes to those of `flat`), where `camera` sees it: map_x and map_y
    (H, W) float32, px, as cv2.remap takes them; NOWHERE where it doesn't."""
    width, height = flat.image_size
    rows = max(BLOCK // width, 1)
    sees = ray_test(camera)
    parts = [_block(camera, flat, R, sees, y, min(y + rows, height)) for y in range(0, height, rows)]
    at = np.concatenate(parts)
    return np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])


def ray_test(camera: Camera) -> Callable[[Camera, Array], Array]:
    """The function that says of a camera like this one and of rays (..., 3) whether the pixels that they reach see them, (...,) bool."""
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
    """(...,) bool: whether the pixels that rays (..., 3) reach see these rays; beyond the lens's fold they see others."""
    gap = np.linalg.norm(_unit(unproject(camera, project(camera, rays))) - _unit(rays), axis=-1)
    return np.asarray(gap < 1e-6)


def _unit(rays: Array) -> Array:
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
