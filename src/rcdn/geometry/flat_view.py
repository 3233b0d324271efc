"""Field of view of an undistorted picture: only pixels that the camera saw, all that it saw, or a compromise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.undistort import HALF_VIEW, ray_test, undistorted_camera
from rcdn.types import Array, Camera
from rcdn.types.arrays import Bool, Real

ALONG = 200
"""points along each side of a picture at which visibility is checked"""
HALVINGS = 40
"""bisection steps in the search for the inner view's focal length"""
MOST_ZOOM = 64.0
"""largest focal length of the inner view, as a multiple of that of `undistorted_camera`"""
ROUNDING = 0.01
"""px; tolerance at the picture's border, since maps are float32"""
COARSE = 256
"""cells along a mask's longer side in the coarse search for its largest rectangle"""


def flat_camera(camera: Camera, balance: float = 0.0) -> Camera:
    """A pinhole camera of the same size, with square pixels, that shows what `camera` saw without its distortion.

    `balance` 0: the view has no empty pixels; 1: it shows all that the camera saw, up to HALF_VIEW from the optical
    axis, with empty pixels elsewhere; in between, the focal length is interpolated geometrically. Raises RcdnError if
    `balance` isn't within 0..1, or if no view without empty pixels was found.
    """
    if not 0 <= balance <= 1:
        raise RcdnError(f"balance must be within 0 (no empty pixels) and 1 (all that the camera saw), not {balance:g}")
    inner = _inner(camera) if balance < 1 else undistorted_camera(camera)
    if balance == 0:
        return inner
    outer = _outer(camera)
    f = inner.K[0, 0] ** (1 - balance) * outer.K[0, 0] ** balance
    centre = (1 - balance) * inner.K[:2, 2] + balance * outer.K[:2, 2]
    return _with_K(inner, f, centre)


def seen(camera: Camera, rays: Array) -> Bool[Array, " ..."]:
    """(...,) bool: whether rays (..., 3) are seen within the picture of `camera`."""
    width, height = camera.image_size
    xy = project(camera, rays)
    with np.errstate(invalid="ignore"):
        inside = ((xy >= -0.5 - ROUNDING) & (xy <= np.array([width, height]) - 0.5 + ROUNDING)).all(axis=-1)
        return np.asarray(inside & ray_test(camera)(camera, rays))


def in_picture(map_x: Array, map_y: Array, size: tuple[int, int]) -> Bool[Array, "h w"]:
    """(H, W) bool: where the maps of `undistortion_maps` point into a picture of `size` (width, height)."""
    low, high = -0.5 - ROUNDING, (size[0] - 0.5 + ROUNDING, size[1] - 0.5 + ROUNDING)
    return np.asarray((map_x >= low) & (map_x <= high[0]) & (map_y >= low) & (map_y <= high[1]))


def largest_rectangle(mask: Real[Array, "h w"]) -> tuple[int, int, int, int]:
    """(left, top, right, bottom), right and bottom exclusive, of a rectangle of `mask` (H, W) bool in which every pixel
    is True.

    It is the largest rectangle of cells of a coarse grid that are True throughout, then grown pixel by pixel as far as
    possible; the empty (0, 0, 0, 0) if there is none.
    """
    height, width = mask.shape
    cell = -(-max(height, width) // COARSE)
    whole = mask[: height // cell * cell, : width // cell * cell]
    cells = whole.reshape(height // cell, cell, width // cell, cell).all(axis=(1, 3))
    left, top, right, bottom = (cell * v for v in _largest_of_cells(np.asarray(cells)))
    if right == left:
        return 0, 0, 0, 0
    grown = True
    while grown:
        grown = False
        if left > 0 and mask[top:bottom, left - 1].all():
            left, grown = left - 1, True
        if right < width and mask[top:bottom, right].all():
            right, grown = right + 1, True
        if top > 0 and mask[top - 1, left:right].all():
            top, grown = top - 1, True
        if bottom < height and mask[bottom, left:right].all():
            bottom, grown = bottom + 1, True
    return left, top, right, bottom


def _inner(camera: Camera) -> Camera:
    """The widest view, with the principal point of `undistorted_camera`, in which every pixel was seen."""
    undistorted = undistorted_camera(camera)
    f, centre = undistorted.K[0, 0], undistorted.K[:2, 2]
    if _all_seen(camera, undistorted):
        return undistorted
    low, high = f, MOST_ZOOM * f
    if not _all_seen(camera, _with_K(undistorted, high, centre)):
        raise RcdnError("no undistorted view without empty pixels was found: the lens sees too little around its axis")
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        if _all_seen(camera, _with_K(undistorted, middle, centre)):
            high = middle
        else:
            low = middle
    return _with_K(undistorted, high, centre)


def _all_seen(camera: Camera, flat: Camera) -> bool:
    return bool(seen(camera, unproject(flat, _rim(flat.image_size, 0.5))).all())


def _outer(camera: Camera) -> Camera:
    """The narrowest view that contains the rays of the picture's border, up to HALF_VIEW from the optical axis, and the
    view of `undistorted_camera`."""
    undistorted = undistorted_camera(camera)
    width, height = camera.image_size
    ends = np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]])
    points = [unproject(undistorted, ends)[:, :2]]
    rays = unproject(camera, _rim(camera.image_size, 0.5))
    rays = rays[np.isfinite(rays).all(axis=1)]
    off = np.hypot(rays[:, 0], rays[:, 1])
    reach = np.tan(np.minimum(np.arctan2(off, rays[:, 2]), np.radians(HALF_VIEW)))
    points.append(rays[:, :2] * (reach / np.maximum(off, 1e-12))[:, None])
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    f = float((np.array([width, height]) / (high - low)).min())
    middle = (np.array([width, height]) - 1) / 2
    return _with_K(undistorted, f, middle - f * (low + high) / 2)


def _with_K(camera: Camera, f: float, centre: Array) -> Camera:
    return replace(camera, K=np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1]]))


def _rim(size: tuple[int, int], beyond: float) -> Real[Array, "n 2"]:
    """Points (N, 2) around a picture, px, at the distance `beyond` outside the centres of its outermost pixels."""
    x, y = (np.linspace(-beyond, side - 1 + beyond, ALONG) for side in size)
    sides = [(x, np.full(ALONG, y[k])) for k in (0, -1)] + [(np.full(ALONG, x[k]), y) for k in (0, -1)]
    return np.concatenate([np.stack(side, axis=1) for side in sides])


def _largest_of_cells(cells: Array) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) of the largest rectangle of True in a small mask, by the row-by-row histogram method
    (the height of each column of True cells, and a stack)."""
    best, box = 0, (0, 0, 0, 0)
    heights = np.zeros(cells.shape[1], int)
    for bottom, row in enumerate(cells, start=1):
        heights = np.where(row, heights + 1, 0)
        waiting: list[tuple[int, int]] = []  # (first column, height), with increasing heights
        for column, tall in enumerate([*heights.tolist(), 0]):
            first = column
            while waiting and waiting[-1][1] >= tall:
                first, high = waiting.pop()
                if high * (column - first) > best:
                    best, box = high * (column - first), (first, bottom - high, column, bottom)
            waiting.append((first, tall))
    return box
