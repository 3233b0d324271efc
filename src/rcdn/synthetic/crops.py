"""Small windows of random scenes for training and validation, with their labels."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from rcdn.synthetic.degrade import expose, legible
from rcdn.synthetic.render import irradiance, truth
from rcdn.synthetic.sample import TRAINING, Ranges, random_scene
from rcdn.synthetic.scene import Scene
from rcdn.types import Array

NEAR, OFTEN = 48, 0.9
"""px around a corner, within which lie the middles of this share of the windows"""
BEYOND = 8
"""px; corners up to this far outside a window keep their labels"""


def random_crop(
    seed: int, size: int = 112, ranges: Ranges = TRAINING, images: Sequence[Array] = ()
) -> tuple[Array, Array]:
    """Picture (size, size) uint8 and labels (N, 3) of one crop; the same seed gives the same crop.

    Labels are x, y in the crop and a class: 1 for a clearly visible corner, 0 for a corner to be ignored (damaged, or
    not legible under its blur and noise). If the ranges include deltilles (`deltille_p`), only their corners are
    labelled, and other boards are clutter. Most windows contain a corner within `NEAR` px of their middle.
    """
    scene, window = crop_scene(seed, size, ranges, len(images))
    if not scene.boards and ranges.busy_p and len(images):
        rng = np.random.default_rng(scene.seed)
        if rng.random() < ranges.busy_p:
            return busy_window(rng, size, images), np.zeros((0, 3))
    light = irradiance(scene, window, samples=2, images=images)
    labels = [np.zeros((0, 3))]
    for spec, board in zip(scene.boards, truth(scene), strict=True):
        if ranges.deltille_p and spec.pattern != "deltille":
            continue
        xy = board.xy - window[:2]
        near = ((xy > -BEYOND) & (xy < size + BEYOND)).all(axis=1) & (board.visible | board.ignore)
        readable = legible(light, scene.sensor, xy[near], board.pitch[near], ranges.unsure)
        sure = board.visible[near] & readable
        labels.append(np.column_stack([xy[near], sure.astype(float)]))
    image, found = expose(light, scene.sensor, np.random.default_rng(scene.seed)), np.concatenate(labels)
    if ranges.faint:
        found[:, 2] *= _plain(image, found[:, :2], ranges.faint)
    return image, found


def crop_scene(seed: int, size: int, ranges: Ranges, image_count: int) -> tuple[Scene, tuple[int, int, int, int]]:
    """The scene of a crop and its window (x, y, width, height)."""
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, ranges, (640, 480), image_count)
    spots = [b.xy[b.visible] for b in truth(scene)]
    xy = np.concatenate(spots) if spots else np.zeros((0, 2))
    if len(xy) and rng.random() < OFTEN:
        middle = xy[rng.integers(len(xy))] + rng.uniform(-NEAR, NEAR, 2) * rng.random()
    else:
        middle = rng.uniform([size / 2, size / 2], [640 - size / 2, 480 - size / 2])
    corner = np.clip(np.rint(middle - size / 2), 0, [640 - size, 480 - size]).astype(int)
    return scene, (int(corner[0]), int(corner[1]), size, size)


def busy_window(rng: np.random.Generator, size: int, images: Sequence[Array], tries: int = 6) -> Array:
    """A window (size, size) uint8 of a photograph: the one with the most detail out of `tries` random windows, with its
    contrast stretched until some pixels saturate.

    Thin bright and dark structures side by side cause false positives, but most of a photograph contains none.
    """
    parts = [_window(rng, size, images[int(rng.integers(len(images)))]) for _ in range(tries)]
    detail = [float(np.abs(cv2.Laplacian(cv2.GaussianBlur(part, (0, 0), 1.2), cv2.CV_32F)).mean()) for part in parts]
    part = parts[int(np.argmax(detail))]
    middle = rng.uniform(np.percentile(part, 20), np.percentile(part, 80))
    part = np.clip((part - middle) * rng.uniform(0.8, 2.2) + rng.uniform(60, 200), 0, 255)
    part = cv2.GaussianBlur(part, (0, 0), rng.uniform(0.4, 1.2)) + rng.normal(0, 1, part.shape) * abs(rng.normal(0, 6))
    return np.clip(np.rint(255 - part if rng.random() < 0.5 else part), 0, 255).astype(np.uint8)


def _window(rng: np.random.Generator, size: int, image: Array) -> Array:
    """A random square of a picture, enlarged or reduced to (size, size) float32."""
    scale = float(np.exp(rng.uniform(np.log(0.35), np.log(1.5))))
    side = min(round(size / scale), min(image.shape) - 1)
    y, x = (int(rng.integers(0, n - side)) for n in image.shape)
    method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(image[y : y + side, x : x + side], (size, size), interpolation=method).astype(np.float32)
    )


def _plain(image: Array, xy: Array, faint: float) -> Array:
    """(N,) bool: whether the standard deviation of the grey levels around positions `xy` (N, 2) is at least `faint`
    times the picture's range (0.1 to 99.9 %)."""
    low, high = np.percentile(image, [0.1, 99.9])
    grey = cv2.GaussianBlur(image.astype(np.float32) / np.float32(max(high - low, 1.0)), (0, 0), 1.0)
    mean, square = cv2.boxFilter(grey, -1, (9, 9)), cv2.sqrBoxFilter(grey, -1, (9, 9))
    x, y = (np.clip(np.rint(xy[:, k]), 0, image.shape[1 - k] - 1).astype(int) for k in (0, 1))
    return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0))[y, x] >= faint)
