"""Rectified pictures of a pair of cameras: how far matching corners are from one row, and one pair to look at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.epipolar import both_used
from rcdn.errors import present
from rcdn.geometry import unproject
from rcdn.io import as_grey
from rcdn.report.calibration import pictures
from rcdn.report.calibration.pictures import Framed, Pictures
from rcdn.types import Array, Camera, StereoCalibration

LINES = 7
"""rows drawn across the rectified pictures"""


@dataclass(frozen=True)
class RectifiedPair:
    """Both rectified pictures of pair `number` (from 1), and the RMS difference of their matching rows, px (`gap`)."""

    number: int
    left: Framed
    right: Framed
    gap: float


def rectify(camera: Camera, R: Array, P: Array, xy: Array) -> Array:
    """Positions (N, 2) of pixels `xy` of `camera` in its rectified picture; NaN where the lens model has no ray."""
    rays = unproject(camera, xy) @ (P[:, :3] @ R).T
    return np.asarray(np.where(rays[:, 2:] > 0, rays[:, :2] / np.where(rays[:, 2:] > 0, rays[:, 2:], 1.0), np.nan))


def row_gaps(stereo: StereoCalibration) -> Array:
    """RMS difference (pairs,) of matching corners perpendicular to the epipolar lines after rectification, px; NaN
    without matches."""
    axis = 1 if beside(stereo) else 0
    out = []
    for a, b in stereo.view_pairs:
        ka, kb = both_used(a, b)
        left = rectify(stereo.left.camera, stereo.R_left, stereo.P_left, a.xy[ka])
        right = rectify(stereo.right.camera, stereo.R_right, stereo.P_right, b.xy[kb])
        gap = (left - right)[:, axis]
        gap = gap[np.isfinite(gap)]
        out.append(float(np.sqrt((gap**2).mean())) if len(gap) else float("nan"))
    return np.array(out)


def beside(stereo: StereoCalibration) -> bool:
    """Whether the cameras are side by side rather than above each other."""
    return abs(stereo.P_right[0, 3]) >= abs(stereo.P_right[1, 3])


def rectified_pair(
    stereo: StereoCalibration, gaps: Array, left: Pictures | None, right: Pictures | None
) -> RectifiedPair | None:
    """The used pair with the most matching corners, rectified, with lines through matching corners; None without
    photographs."""
    if left is None or right is None:
        return None
    views = stereo.view_pairs
    order = sorted(
        (k for k, (a, b) in enumerate(views) if not a.reason and not b.reason),
        key=lambda k: -len(both_used(*views[k])[0]),
    )
    sizes = stereo.left.camera.image_size, stereo.right.camera.image_size
    for k in order[: pictures.TRIES]:
        found = left(views[k][0].name), right(views[k][1].name)
        if all(p is not None and p.shape[:2] == s[::-1] for p, s in zip(found, sizes, strict=True)):
            first, second = _both(stereo, k, [present(p, "a picture") for p in found])
            return RectifiedPair(k + 1, first, second, float(gaps[k]))
    return None


def _both(stereo: StereoCalibration, k: int, found: list[Array]) -> Iterator[Framed]:
    """The left picture of pair `k`, then the right one; both have the rows of the left one."""
    a, b = stereo.left.views[k], stereo.right.views[k]
    ka, kb = both_used(a, b)
    axis = 1 if beside(stereo) else 0
    across = np.argsort(rectify(stereo.left.camera, stereo.R_left, stereo.P_left, a.xy[ka])[:, axis], kind="stable")
    pick = across[np.unique(np.linspace(0, len(ka) - 1, LINES).astype(int))] if len(ka) else across
    level = None
    sides = (
        ("Left", stereo.left, stereo.R_left, stereo.P_left, a.xy[ka]),
        ("Right", stereo.right, stereo.R_right, stereo.P_right, b.xy[kb]),
    )
    for (name, calibration, R, P, xy), picture in zip(sides, found, strict=True):
        image, spots = _rectified(calibration.camera, R, P, stereo.left.camera.image_size, xy, picture)
        size = image.shape[1], image.shape[0]
        level = spots[pick][:, axis] if level is None else level
        ends = [[[-1, y], [size[0], y]] if axis else [[y, -1], [y, size[1]]] for y in level[np.isfinite(level)]]
        overlay = pictures.chord_overlay(np.array(ends).reshape(-1, 2, 2), spots[pick])
        alt = f"{name} picture of pair {k + 1}, rectified, with lines through matching corners"
        yield Framed(size, pictures.jpeg(image, pictures.SAMPLE_QUALITY), overlay, alt)


def _rectified(
    camera: Camera, R: Array, P: Array, whole: tuple[int, int], xy: Array, picture: Array
) -> tuple[Array, Array]:
    """A photograph, rectified to a picture of `whole` (width, height) px and reduced in size, and where it shows the
    pixels `xy` (N, 2) of the camera."""
    own, size = _reduced(camera.image_size), _reduced(whole)
    small = pictures.shrunk(as_grey(picture), own)
    flat = Camera(P[:, :3], np.zeros(0), whole, "pinhole")
    image = pictures.undistort(small, camera.resized(own), flat.resized(size), R)
    ratio = np.array(size) / np.array(whole)
    return image, (rectify(camera, R, P, xy) + 0.5) * ratio - 0.5


def _reduced(size: tuple[int, int]) -> tuple[int, int]:
    factor = min(1.0, pictures.SAMPLE_WIDTH / max(size))
    return round(size[0] * factor), round(size[1] * factor)
