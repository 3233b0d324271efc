"""Drawings as pixels: each pixel the mean of 4 × 4 samples, a sample being black where the last shape over it is."""

from __future__ import annotations

import numpy as np

from rcdn.types.shapes import Area, Disc, Rect

OVER = 4


def raster(shapes, width: float, height: float, scale: float) -> np.ndarray:
    """The picture (H, W) uint8 of (0, 0) to (`width`, `height`), `scale` pixels a unit;
    the pixel of a point is scale · point − 1/2."""
    many = scale * OVER
    image = np.full((round(height * many / OVER) * OVER, round(width * many / OVER) * OVER), 255, np.uint8)
    for shape in shapes:
        _paint(image, shape, many)
    rows, columns = (n // OVER for n in image.shape)
    return image.reshape(rows, OVER, columns, OVER).mean(axis=(1, 3)).round().astype(np.uint8)


def _paint(image: np.ndarray, shape, scale: float) -> None:
    if isinstance(shape, Disc):
        (x, y), r = (shape.x * scale, shape.y * scale), shape.radius * scale
        left, top = max(int(x - r) - 1, 0), max(int(y - r) - 1, 0)
        part = image[top : int(y + r) + 2, left : int(x + r) + 2]
        v, u = np.indices(part.shape) + 0.5
        part[np.hypot(u + left - x, v + top - y) < r] = 255 if shape.white else 0
        return
    if isinstance(shape, Rect):
        a, b = (shape.x, shape.y), (shape.x + shape.width, shape.y + shape.height)
        shape = Area((((a[0], a[1]), (b[0], a[1]), (b[0], b[1]), (a[0], b[1])),))
    loops = [np.array(loop) * scale for loop in shape.loops]
    points = np.concatenate(loops)
    left, top = (max(int(v) - 1, 0) for v in points.min(axis=0))
    part = image[top : int(points[:, 1].max()) + 2, left : int(points[:, 0].max()) + 2]
    crossed = np.zeros((part.shape[0], part.shape[1] + 1), np.uint8)
    for loop in loops:
        for p, q in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            _cross(crossed, p - (left, top), q - (left, top))
    part[np.bitwise_xor.accumulate(crossed[:, :-1], axis=1) == 1] = 0


def _cross(crossed: np.ndarray, p: np.ndarray, q: np.ndarray) -> None:
    """Mark, in each row of samples that the edge crosses, the first sample to the right of it."""
    (_, y0), (_, y1) = sorted((tuple(p), tuple(q)), key=lambda a: a[1])
    row = np.arange(max(int(np.ceil(y0 - 0.5)), 0), min(int(np.ceil(y1 - 0.5)), len(crossed)))
    if len(row):
        x = p[0] + (q[0] - p[0]) * (row + 0.5 - p[1]) / (q[1] - p[1])
        crossed[row, np.clip(np.ceil(x - 0.5), 0, crossed.shape[1] - 1).astype(int)] ^= 1
