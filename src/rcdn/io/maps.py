"""Maps for undistorting or rectifying a camera's pictures with cv2.remap, as NumPy's .npz."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from rcdn.errors import FormatError
from rcdn.geometry.undistort import undistorted_camera, undistortion_maps
from rcdn.io.cameras.rig import StereoCameras
from rcdn.io.files import check_writable, write_bytes
from rcdn.types import Array, Camera, StereoCalibration

MOST_PIXELS = 1 << 28
"""largest size of a picture with maps, which then take 2 GB"""


def write_maps(path: str | Path, camera: Camera) -> None:
    """Write `map_x` and `map_y` (H, W) float32, px, for `cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR)`, and `K`
    (3, 3) of the pinhole camera of the resulting picture, which has the same size; whole or not at all.

    Pixels that the camera doesn't see are mapped far outside the picture. Raises OutputError as `write_bytes`.
    """
    _check_size(path, camera)
    flat = undistorted_camera(camera)
    _write(path, K=flat.K, **_maps(camera, flat, None))


def write_stereo_maps(path: str | Path, pair: StereoCameras | StereoCalibration) -> list[Path]:
    """As `write_maps`, for two cameras: files `path` with _left and _right, whose maps also rectify; they also contain
    `R` (3, 3), `P` (3, 4) and `Q` (4, 4) in OpenCV's notation. Both rectified pictures have the size of the left
    camera's. Raises RcdnError for two cameras at one place."""
    found = StereoCameras.of(pair)
    turns = found.turns
    for camera in (found.left, found.right):
        _check_size(path, camera)
    target = Path(path)
    files = [target.with_stem(f"{target.stem}_{side}") for side in ("left", "right")]
    for file in files:
        check_writable(file)
    sides = ((found.left, turns.R_left, turns.P_left), (found.right, turns.R_right, turns.P_right))
    for file, (camera, R, P) in zip(files, sides, strict=True):
        flat = Camera(P[:, :3], np.zeros(0), found.left.image_size, "pinhole")
        _write(file, K=flat.K, R=R, P=P, Q=turns.Q, **_maps(camera, flat, R))
    return files


def _check_size(path: str | Path, camera: Camera) -> None:
    """Raise FormatError if the maps would not fit into the memory of a usual machine."""
    width, height = camera.image_size
    if width * height > MOST_PIXELS:
        raise FormatError(f"{path}: maps of {width}×{height} px are too large; {MOST_PIXELS} pixels are the most")


def _maps(camera: Camera, flat: Camera, R: Array | None) -> dict[str, Array]:
    x, y = undistortion_maps(camera, flat, R)
    return {"map_x": x, "map_y": y}


def _write(path: str | Path, **arrays: Array) -> None:
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **arrays)
    write_bytes(path, data.getvalue())
