"""Implementation of the methods of `Camera` by the packages above `types`: lens models, undistortion, files."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from rcdn import geometry, io
from rcdn.errors import ConfigError, ImageError
from rcdn.geometry.flat_view import flat_camera
from rcdn.geometry.inverse import before_fold
from rcdn.geometry.resample import Undistortion, rectification, undistortion
from rcdn.geometry.undistort import ray_test
from rcdn.types import Array, Camera, Pose, StereoCalibration

Conversions = tuple[Undistortion, ...]
KEPT = 256 << 20
"""bytes of maps that are kept, of the last cameras: two of 12 megapixels, thirty of 1280 × 720"""


def project(camera: Camera, points: Array, pose: Pose | None) -> Array:
    """See `Camera.project`."""
    points = points if pose is None else geometry.transform(pose, points)
    with np.errstate(all="ignore"):  # of points without a ray
        return np.where(_seen(camera, points)[..., None], geometry.project(camera, points), np.nan)


def _seen(camera: Camera, points: Array) -> Array:
    """(...,) bool: whether the pixels of points (..., 3) see them, and don't lie beyond a fold of the lens."""
    plain = camera.correction is None and camera.model != "division"
    return (before_fold if plain else ray_test(camera))(camera, points)


def unproject(camera: Camera, xy: Array) -> Array:
    """See `Camera.unproject`."""
    return geometry.unproject(camera, xy)


def undistorted(camera: Camera, balance: float) -> Camera:
    """See `Camera.undistorted`."""
    return flat_camera(camera, _number(balance))


def undistort(camera: Camera, image: Any, balance: float) -> Array:
    """See `Camera.undistort`."""
    return _undistortion(camera, _number(balance))(_pixels(image))


def undistortion_maps(camera: Camera, balance: float) -> tuple[Array, Array]:
    """See `Camera.undistortion_maps`."""
    made = _undistortion(camera, _number(balance))
    return made.map_x.copy(), made.map_y.copy()


def _number(balance: Any) -> float:
    """`balance` as a float. Raises ConfigError for anything else, such as a picture passed by mistake."""
    if not isinstance(balance, Real):
        raise ConfigError(f"balance must be a number, not {type(balance).__name__}; pictures go to undistort(image)")
    return float(balance)


_kept: tuple[tuple[object, float, Conversions], ...] = ()
"""the last conversions, the latest first; replaced as a whole, so that threads need no lock"""


def _undistortion(camera: Camera, balance: float) -> Undistortion:
    """The conversion of a camera's pictures."""
    return _conversions(camera, balance, lambda: (undistortion(camera, balance),))[0]


def _conversions(owner: object, balance: float, make: Callable[[], Conversions]) -> Conversions:
    """The conversions of a camera or a pair, made if they aren't kept. The last ones are kept, and those before them
    within KEPT bytes."""
    global _kept
    made = next((made for of, at, made in _kept if of is owner and at == balance), None)
    made = make() if made is None else made
    recent, left = [(owner, balance, made)], KEPT - _bytes(made)
    for of, at, other in _kept:
        left -= _bytes(other) * (other is not made)
        if other is not made and left >= 0:
            recent.append((of, at, other))
    _kept = tuple(recent)
    return made


def _bytes(made: Conversions) -> int:
    return sum(each.map_x.nbytes + each.map_y.nbytes + each.empty.nbytes for each in made)


_CONVERTED = {"1": "L", "P": "RGB", "PA": "RGBA"}
"""modes of PIL images whose values are no brightness, and those to which they are converted"""


def _pixels(image: Any) -> Array:
    """A picture as an array that OpenCV can resample."""
    if isinstance(image, str | Path) or image is None:
        raise ImageError(f"image must be the pixels of a picture, not {type(image).__name__}; read it, with cv2.imread")
    if getattr(image, "mode", None) in _CONVERTED and hasattr(image, "convert"):
        image = image.convert(_CONVERTED[image.mode])
    if np.ma.is_masked(image):
        raise ImageError("image has masked pixels; fill them first, e.g. with image.filled(0)")
    pixels = np.asarray(image)
    dtype = pixels.dtype.newbyteorder("=")
    dtype = np.dtype(np.float32) if dtype == np.float16 else dtype
    if pixels.ndim not in (2, 3) or dtype not in (np.uint8, np.uint16, np.float32, np.float64) or not pixels.size:
        what = f"{pixels.dtype} {pixels.shape}"
        raise ImageError(f"image must be (H, W) or (H, W, channels), uint8, uint16 or float, and not empty, not {what}")
    return np.ascontiguousarray(pixels, dtype)


def rectify(pair: StereoCalibration | io.StereoCameras, left: Any, right: Any) -> tuple[Array, Array]:
    """See `StereoCalibration.rectify`."""
    first, second = _conversions(pair, 0.0, lambda: _rectifications(io.StereoCameras.of(pair)))
    return first(_pixels(left)), second(_pixels(right))


def _rectifications(pair: io.StereoCameras) -> tuple[Undistortion, Undistortion]:
    return rectification_of(pair, right=False), rectification_of(pair, right=True)


def rectification_of(pair: io.StereoCameras, right: bool) -> Undistortion:
    """The conversion of the pictures of one of two cameras, the `right` one or the left one, to rectified ones."""
    turns, size = pair.turns, pair.left.image_size
    if right:
        return rectification(pair.right, turns.R_right, turns.P_right, size)
    return rectification(pair.left, turns.R_left, turns.P_left, size)


def save(camera: Camera, path: str | Path, format: str | None) -> str:
    """See `Camera.save`."""
    fit = io.write_camera(path, camera, format)  # type: ignore[arg-type]  # its value is checked there
    return "" if fit is None else fit.text


def load(path: str | Path, name: str | None, format: str | None) -> Camera:
    """See `Camera.load`."""
    return io.read_camera(path, format, name)  # type: ignore[arg-type]  # as in `save`
