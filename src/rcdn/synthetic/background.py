"""Backgrounds: textures and clutter that contain no boards, but may cause false positives."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from rcdn.synthetic.scene import Background
from rcdn.types import Array

F32 = np.float32
KINDS = ("plain", "noise", "shapes", "text", "tiles", "blocks")


def paint(spec: Background, width: int, height: int, images: Sequence[Array] = ()) -> Array:
    """Reflectance (height, width) float32 in 0..1 of the background. `images`: grey pictures for the kind `image`,
    which becomes noise if there are none."""
    rng = np.random.default_rng(spec.seed)
    if spec.kind == "image" and len(images):
        return _crop(images[spec.image % len(images)], width, height, rng)
    if spec.kind == "plain":
        return np.full((height, width), rng.uniform(0.05, 0.95), F32)
    base = _octaves(rng, width, height)
    draw = {"shapes": _shapes, "text": _text, "tiles": _tiles, "blocks": _blocks}.get(spec.kind)
    if draw is None:
        return base
    canvas = np.clip(base * 255, 0, 255).astype(np.uint8)
    draw(canvas, rng)
    return np.asarray(canvas.astype(F32) / 255)


def _crop(image: Array, width: int, height: int, rng: np.random.Generator) -> Array:
    h, w = image.shape
    least = max(width / w, height / h)
    scale = max(least, float(np.exp(rng.uniform(np.log(0.3), np.log(1.5)))))
    cw, ch = min(w, round(width / scale)), min(h, round(height / scale))
    x, y = int(rng.integers(0, w - cw + 1)), int(rng.integers(0, h - ch + 1))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    part = cv2.resize(image[y : y + ch, x : x + cw], (width, height), interpolation=method)
    if rng.random() < 0.5:
        part = part[:, ::-1]
    return np.asarray(part.astype(F32) / 255)


def _octaves(rng: np.random.Generator, width: int, height: int) -> Array:
    out = np.full((height, width), rng.uniform(0.1, 0.9), F32)
    amplitude = rng.uniform(0.05, 0.4)
    for cells in (2, 5, 12, 30):
        grid = rng.uniform(-1, 1, (cells, cells)).astype(F32)
        out += F32(amplitude) * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
        amplitude *= rng.uniform(0.3, 0.8)
    return np.clip(out, 0, 1)


def _grey(rng: np.random.Generator) -> int:
    return int(rng.integers(0, 256))


def _point(rng: np.random.Generator, canvas: Array) -> tuple[int, int]:
    return int(rng.integers(-10, canvas.shape[1] + 10)), int(rng.integers(-10, canvas.shape[0] + 10))


def _shapes(canvas: Array, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(3, 25))):
        kind, a = rng.integers(4), _point(rng, canvas)
        size = int(rng.integers(4, 80))
        if kind == 0:
            cv2.rectangle(canvas, a, (a[0] + size, a[1] + int(rng.integers(4, 80))), _grey(rng), -1)
        elif kind == 1:
            cv2.line(canvas, a, _point(rng, canvas), _grey(rng), int(rng.integers(1, 9)), cv2.LINE_AA)
        elif kind == 2:
            cv2.circle(canvas, a, max(2, size // 2), _grey(rng), int(rng.choice([-1, 1, 3])), cv2.LINE_AA)
        else:
            points = (np.array(a) + rng.integers(-size, size + 1, (int(rng.integers(3, 6)), 2))).astype(np.int32)
            cv2.fillPoly(canvas, [points], _grey(rng), cv2.LINE_AA)


def _text(canvas: Array, rng: np.random.Generator) -> None:
    letters = "ABCDEFGHIJKLMNOPRSTUXYZ0123456789#+=%&xkw"
    for _ in range(int(rng.integers(2, 12))):
        word = "".join(rng.choice(list(letters), int(rng.integers(2, 12))))
        scale = float(rng.uniform(0.3, 2.0))
        at, font, grey, thick = _point(rng, canvas), int(rng.integers(0, 8)), _grey(rng), int(rng.integers(1, 4))
        cv2.putText(canvas, word, at, font, scale, grey, thick, cv2.LINE_AA)


def _tiles(canvas: Array, rng: np.random.Generator) -> None:
    """Bricks, window panes, shelves, stripes, keyboards: lattices with T-, +- and L-junctions, but no X-corners.

    The grey level of a tile is the sum of a term of its row and one of its column, which never forms a saddle, and
    joints are narrow, since wide ones between staggered tiles would form a checkerboard.
    """
    h, w = canvas.shape
    step = int(rng.integers(6, 50))
    gap = int(rng.integers(1, max(2, min(6, step // 4))))
    tall = int(step * rng.uniform(0.4, 1.6)) + 2
    shift = int(rng.choice([0, step // 2, step // 3]))
    one, joint, spread = _grey(rng), _grey(rng), int(rng.integers(0, 60))
    layer = np.full((2 * h, 2 * w), joint, np.uint8)
    stripes = rng.random() < 0.2
    by_row, by_column = rng.integers(-spread // 2, spread // 2 + 1, (2, 4 * max(h, w)))
    for row, y in enumerate(range(0, 2 * h, tall)):
        for column, x in enumerate(range(-step + (row % 2) * shift, 2 * w, step)):
            grey = int(np.clip(one + by_row[row] + by_column[column], 0, 255))
            cv2.rectangle(layer, (x, y), (x + step - gap, y + tall - (0 if stripes else gap)), grey, -1)
    turn = cv2.getRotationMatrix2D((w, h), float(rng.uniform(0, 360)), float(rng.uniform(0.7, 1.4)))
    turn[:, 2] -= [w / 2, h / 2]
    canvas[:] = cv2.warpAffine(layer, turn, (w, h), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT)


def _blocks(canvas: Array, rng: np.random.Generator) -> None:
    """Patches of random binary cells of 2–4 px, similar to 2-D codes and distant markers."""
    for _ in range(int(rng.integers(1, 4))):
        n, cell = int(rng.integers(6, 20)), int(rng.integers(2, 5))
        low, high = sorted(rng.integers(0, 256, 2).tolist())
        bits = (rng.random((n, n)) < 0.5).astype(np.uint8) * (high - low) + low
        patch = cv2.resize(bits.astype(np.uint8), (n * cell, n * cell), interpolation=cv2.INTER_NEAREST)
        x, y = _point(rng, canvas)
        x, y = max(0, min(x, canvas.shape[1] - 1)), max(0, min(y, canvas.shape[0] - 1))
        part = canvas[y : y + n * cell, x : x + n * cell]
        part[:] = patch[: part.shape[0], : part.shape[1]]
