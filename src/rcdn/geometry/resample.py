"""Resampling of pictures to remove distortion: any number of channels, of 8 or 16 bits or floats."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.flat_view import flat_camera, in_picture, largest_rectangle
from rcdn.geometry.undistort import undistortion_maps
from rcdn.types import Array, Camera

LONGEST_SIDE = 32766
"""px; OpenCV's remap counts pixels in 16 bits"""

MOST_PIXELS = 1 << 28
"""pixels of the largest undistorted picture, whose maps take 2 GB"""
CHANNELS = 4
"""most channels of a picture that OpenCV resamples at once"""


@dataclass(frozen=True, eq=False)
class Undistortion:
    """Converts pictures of `camera` to those of the pinhole camera `flat`; created by `undistortion`, then called for
    each picture.

    `map_x`, `map_y` (H, W): source position of each pixel, px; `empty` (H, W) bool: pixels without a source. The maps
    may be larger than the picture of `flat`, which is then obtained by averaging over areas.
    """

    camera: Camera
    flat: Camera
    map_x: Array
    map_y: Array
    empty: Array

    def __call__(self, picture: Array) -> Array:
        """`picture` (H, W) or (H, W, C), uint8, uint16, float32 or float64 (resampled as float32), of the camera's
        size, without distortion; empty pixels are 0.

        Raises RcdnError if it has another size.
        """
        height, width = picture.shape[:2]
        if (width, height) != tuple(self.camera.image_size):
            wide, high = self.camera.image_size
            raise RcdnError(
                f"the picture has {width}×{height} px, but the camera was calibrated at {wide}×{high} px; "
                "give the camera of this size"
            )
        # OpenCV rounds float64 at the border
        exact = picture.astype(np.float32) if picture.dtype == np.float64 else picture
        planes = exact.reshape(height, width, -1)
        parts = [self._resampled(planes[:, :, k : k + CHANNELS]) for k in range(0, planes.shape[2], CHANNELS)]
        out = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)
        out = out.astype(picture.dtype, copy=False)
        return out[:, :, 0] if picture.ndim == 2 else out

    def _resampled(self, planes: Array) -> Array:
        """(H, W, C) of `planes` (H', W', C), at most CHANNELS."""
        # the outer half pixels of the border repeat the outermost pixels; otherwise they would fade to black
        source = np.ascontiguousarray(planes)
        out = cv2.remap(source, self.map_x, self.map_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        out[self.empty] = 0
        if out.shape[1::-1] != tuple(self.flat.image_size):
            out = cv2.resize(out, self.flat.image_size, interpolation=cv2.INTER_AREA)
        return out.reshape(*out.shape[:2], planes.shape[2])


def undistortion(camera: Camera, balance: float = 0.0, scale: float = 1.0, crop: bool = False) -> Undistortion:
    """The conversion from pictures of `camera` to those of `flat_camera(camera, balance)`, `scale` times as large.

    `crop`: keep only the largest rectangle without empty pixels. Raises RcdnError if `balance` isn't within 0..1,
    `scale` isn't above 0, a side would exceed LONGEST_SIDE or the picture MOST_PIXELS, or the crop would be empty.
    """
    if not scale > 0:
        raise RcdnError(f"scale must be above 0, not {scale:g}")
    flat = flat_camera(camera, balance)
    made = flat if scale <= 1 else flat.resized(_times(flat.image_size, scale))
    _check_size(made.image_size, camera.image_size)
    map_x, map_y = undistortion_maps(camera, made)
    filled = in_picture(map_x, map_y, camera.image_size)
    if crop:
        left, top, right, bottom = largest_rectangle(filled)
        if left == right:
            raise RcdnError("crop: no rectangle is without empty pixels; leave it out")
        made = made.cropped(left, top, right - left, bottom - top)
        rows, columns = slice(top, bottom), slice(left, right)
        map_x, map_y, filled = map_x[rows, columns], map_y[rows, columns], filled[rows, columns]
    final = made if scale >= 1 else made.resized(_times(made.image_size, scale))
    maps = np.ascontiguousarray(map_x), np.ascontiguousarray(map_y)
    return Undistortion(camera, final, *maps, ~filled)


def rectification(camera: Camera, R: Array, P: Array, size: tuple[int, int]) -> Undistortion:
    """The conversion from pictures of `camera` to rectified ones of `size` (width, height): of the pinhole camera `P`
    (3, 4), whose axes `R` (3, 3) turns the camera's to. Raises RcdnError for pictures that are too large."""
    flat = Camera(P[:, :3], None, size, "pinhole")
    _check_size(flat.image_size, camera.image_size)
    map_x, map_y = undistortion_maps(camera, flat, R)
    return Undistortion(camera, flat, map_x, map_y, ~in_picture(map_x, map_y, camera.image_size))


def _check_size(made: tuple[int, int], taken: tuple[int, int]) -> None:
    """Raise RcdnError if pictures of the size `made` (width, height), of ones of the size `taken`, are too large."""
    longest = max(*taken, *made)
    if longest > LONGEST_SIDE:
        raise RcdnError(f"sides of pictures can be {LONGEST_SIDE} px at most here, not {longest}; lower the scale")
    if made[0] * made[1] > MOST_PIXELS:
        raise RcdnError(f"a picture of {made[0]}×{made[1]} px is too large; lower the scale")


def _times(size: tuple[int, int], scale: float) -> tuple[int, int]:
    return max(round(scale * size[0]), 1), max(round(scale * size[1]), 1)
