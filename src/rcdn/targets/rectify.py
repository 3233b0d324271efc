"""Rectification of a board: its squares sampled on a regular raster, including the ring of squares around its
corners."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.geometry import apply_homography, homography
from rcdn.native import bind
from rcdn.types import Array, Board
from rcdn.types.arrays import Real

_extrapolated = bind("rcdn_extrapolated")

FAR = -1e6
"""px; the position given to samples that don't exist, far outside the picture"""


def grid_with_ring(board: Board) -> tuple[Array, Array]:
    """Corner positions (rows + 2, columns + 2, 2) px, with one more line on each side, and which of them were detected;
    the others are predicted from their neighbours."""
    grid = np.pad(board.grid(), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    return extrapolated(grid), np.isfinite(grid[..., 0])


def extrapolated(grid: Array) -> Array:
    """A grid (R, C, 2) with what is NaN predicted from its neighbours, outwards until nothing more can be."""
    grid = grid.copy()
    for _ in range(max(grid.shape)):
        predicted = _predicted(grid)
        hole = ~np.isfinite(grid[..., 0]) & np.isfinite(predicted[..., 0])
        if not hole.any():
            break
        grid[hole] = predicted[hole]
    return grid


def wider(grid: Array) -> Real[Array, "r c 2"]:
    """A grid (R, C, 2) with one more line on each side, (R + 2, C + 2, 2), predicted from its neighbours; NaN where
    none can."""
    out = np.pad(grid, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    for _ in range(2):  # the second pass predicts the corners of the grid from the added lines
        predicted = _predicted(out)
        hole = ~np.isfinite(out[..., 0])
        out[hole] = predicted[hole]
    return out


def _predicted(grid: Array) -> Array:
    """Each position extrapolated from the three, or two, before it in a line, averaged over those of the four
    directions that have them; NaN where none has."""
    out = np.empty(grid.shape)
    _extrapolated(np.ascontiguousarray(grid, np.float64), out)
    return out


def rectified(grey: Array, grid: Array, samples: int) -> Array:
    """Grey levels of the squares between the corners of a `grid_with_ring`, (rows − 1, columns − 1, samples, samples)
    float32, NaN outside the picture."""
    rows, columns = grid.shape[0] - 1, grid.shape[1] - 1
    down, across = linear_weights(rows, samples), linear_weights(columns, samples)
    xy = np.einsum("ar,rcx,bc->abx", down, np.nan_to_num(grid, nan=FAR), across, optimize=True)
    values = _sampled(grey, xy, np.sqrt(_area(grid)) / samples)
    return values.reshape(rows, samples, columns, samples).swapaxes(1, 2)


def sampled_squares(grey: Array, xy: Real[Array, "a b 2"], rows: int, columns: int) -> Array:
    """Grey levels at the regular samples `xy` of `rows` × `columns` squares, px, as `rectified` has them; NaN where a
    place is NaN."""
    step = float(np.nanmedian(np.linalg.norm(np.diff(xy, axis=1), axis=2)))
    values = _sampled(grey, np.nan_to_num(xy, nan=FAR), step)
    return values.reshape(rows, len(values) // rows, columns, -1).swapaxes(1, 2)


def squares_in_perspective(
    grey: Array, grid: Array, row: Real[Array, " k"], column: Real[Array, " k"], places: Real[Array, " s"]
) -> Real[Array, "k s s"]:
    """Grey levels (K, S, S) of the squares `row`, `column` (K,) between corners of a `grid_with_ring`, at `places` (S,)
    squares from their first corner along each axis. The perspective within a square, which moves its centre by some
    thousandths of a square, is modelled. NaN outside the picture."""
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape[1::-1])), axis=2).astype(float)
    seen = np.isfinite(grid[..., 0])
    H = homography(nodes[seen], grid[seen])
    off = np.nan_to_num(grid - apply_homography(H, nodes), nan=FAR)
    corners = np.array([[off[row + b, column + a] for a in (0, 1)] for b in (0, 1)])
    shares = np.stack([1 - places, places])
    x, y = np.meshgrid(places, places)
    at = np.stack([column[:, None, None] + x, row[:, None, None] + y], axis=-1)
    xy = apply_homography(H, at) + np.einsum("bakx,bi,aj->kijx", corners, shares, shares)
    step = np.sqrt(_area(grid)) * float(places[1] - places[0])
    return _sampled(grey, xy.reshape(-1, len(places), 2), step).reshape(xy.shape[:3])


def whole_squares(found: Array) -> Array:
    """(rows − 1, columns − 1) bool: the squares all four corners of which were `found` (rows, columns)."""
    return np.asarray(found[:-1, :-1] & found[1:, :-1] & found[:-1, 1:] & found[1:, 1:])


def linear_weights(count: int, samples: int) -> Array:
    """Weights (count · samples, count + 1) of linear interpolation at the midpoints of `samples` equal steps between
    nodes."""
    at = (np.arange(count * samples) + 0.5) / samples
    return np.maximum(1 - np.abs(at[:, None] - np.arange(count + 1)), 0)


def aspect_of(grid: Array) -> float:
    """Median width ÷ median height of the squares of a grid, in pixels."""
    width, height = (np.linalg.norm(np.diff(grid, axis=axis), axis=2) for axis in (1, 0))
    return float(np.nanmedian(width) / np.nanmedian(height))


def _area(grid: Array) -> float:
    """Median area of a square, px²."""
    right, down = np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1]
    area = np.abs(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])
    return float(np.nanmedian(area)) if np.isfinite(area).any() else 1.0


def _sampled(grey: Array, xy: Real[Array, "... 2"], step: float) -> Array:
    """Grey levels at `xy` (..., 2) px, `step` px apart; the picture is first downsampled to about that step, against
    aliasing."""
    x, y = xy[..., 0], xy[..., 1]  # separately: NumPy is slow for both together
    near = (x > -0.5 * grey.shape[1]) & (y > -0.5 * grey.shape[0])
    if not near.any():
        return np.full(xy.shape[:-1], np.nan, np.float32)
    x, y = x[near], y[near]
    low = np.clip(np.floor((x.min(), y.min())) - 4, 0, np.array(grey.shape[::-1]) - 1).astype(int)
    high = np.clip(np.ceil((x.max(), y.max())) + 5, low + 1, grey.shape[::-1]).astype(int)
    part = grey[low[1] : high[1], low[0] : high[0]]
    size = np.maximum(np.array(part.shape[::-1]) // max(int(step), 1), 1)
    ratio = size / part.shape[::-1]
    if int(step) > 1:
        part = cv2.resize(part, tuple(size.tolist()), interpolation=cv2.INTER_AREA)
    else:
        ratio = np.ones(2)
    at = ((xy - low + 0.5) * ratio - 0.5).astype(np.float32)
    nothing = float("nan")
    out = cv2.remap(
        part.astype(np.float32),
        at[..., 0],
        at[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=nothing,
    )
    return np.asarray(out)
