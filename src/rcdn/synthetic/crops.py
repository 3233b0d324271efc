"""Small windows of random scenes for training and validation: the picture and its labels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.synthetic.degrade import expose, legible
from rcdn.synthetic.render import irradiance, truth
from rcdn.synthetic.sample import TRAINING, Ranges, random_scene
from rcdn.synthetic.scene import Scene
from rcdn.types import Array


def random_crop(
    seed: int, size: int = 112, ranges: Ranges = TRAINING, images: Sequence[Array] = ()
) -> tuple[Array, Array]:
    """Picture (size, size) uint8 and labels (N, 3) of one crop; the same seed gives the same crop.

    Labels are x, y in the crop and a kind: 1 a corner that is plainly there, 0 one to be neither demanded nor forbidden
    (damaged, or not legible under its blur and noise).
    Most windows hold a corner within 48 px of their middle.
    """
    scene, window = crop_scene(seed, size, ranges, len(images))
    light = irradiance(scene, window, samples=2, images=images)
    labels = [np.zeros((0, 3))]
    for board in truth(scene):
        xy = board.xy - window[:2]
        near = ((xy > -8) & (xy < size + 8)).all(axis=1) & (board.visible | board.ignore)
        told = legible(light, scene.sensor, xy[near], board.pitch[near], ranges.faint, ranges.unsure)
        sure = board.visible[near] & told
        labels.append(np.column_stack([xy[near], sure.astype(float)]))
    return expose(light, scene.sensor, np.random.default_rng(scene.seed)), np.concatenate(labels)


def crop_scene(seed: int, size: int, ranges: Ranges, image_count: int) -> tuple[Scene, tuple[int, int, int, int]]:
    """The scene of a crop and its window (x, y, width, height)."""
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, ranges, (640, 480), image_count)
    spots = [b.xy[b.visible] for b in truth(scene)]
    xy = np.concatenate(spots) if spots else np.zeros((0, 2))
    if len(xy) and rng.random() < 0.9:
        middle = xy[rng.integers(len(xy))] + rng.uniform(-48, 48, 2) * rng.random()
    else:
        middle = rng.uniform([size / 2, size / 2], [640 - size / 2, 480 - size / 2])
    corner = np.clip(np.rint(middle - size / 2), 0, [640 - size, 480 - size]).astype(int)
    return scene, (int(corner[0]), int(corner[1]), size, size)
