"""Hard negatives: crops on which a network answers where there is no corner are drawn more often."""

from __future__ import annotations

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import numpy as np
import torch

from rcdn.training.config import TrainConfig
from rcdn.training.mining import false_answers
from rcdn.training.net import Architecture
from rcdn.training.on_device import DevicePool
from rcdn.training.samples import Pool, windows

CONFIG = TrainConfig("m", "A")
SIZE = 32


class Brightness(torch.nn.Module):
    """Answers with the grey level, doubled."""

    def __init__(self):
        super().__init__()
        self.architecture = Architecture(((1, 1, 1),))
        self.gain = torch.nn.Parameter(torch.tensor(2.0))

    def forward(self, image):
        return image[:, 0] * self.gain


def pool_of(*spots):
    """A crop each: dark, with one bright corner, and with bright pixels at `spots` (x, y) that are none."""
    images, labels = np.zeros((len(spots), SIZE, SIZE), np.uint8), np.full((len(spots), 512, 3), np.nan, np.float32)
    labels[:, 0] = 10, 12, 1
    images[:, 12, 10] = 200
    for image, pixels in zip(images, spots, strict=True):
        for x, y in pixels:
            image[y, x] = 200
    return Pool(images, labels)


FAR, NEAR = [(25, 20), (5, 28)], [(13, 12), (10, 9)]


@pytest.mark.parametrize("there", [False, True])
def test_what_is_answered_away_from_corners_counts(there):
    pool = pool_of(FAR, NEAR, FAR[:1], [])
    device = DevicePool(pool, "minmax", True, False, torch.device("cpu")) if there else None
    assert false_answers(Brightness(), CONFIG, pool, device).tolist() == [2, 2, 3, 3]


def test_crops_are_drawn_by_it():
    pool = pool_of(FAR, NEAR, FAR[:1], [])
    often = false_answers(Brightness(), CONFIG, pool, None).numpy()
    drawn = np.concatenate([windows(4, 0, 10, "minmax", (k,), often).crop[::2] for k in range(300)])
    assert np.bincount(drawn, minlength=4) / len(drawn) == pytest.approx([2 / 3, 0, 1 / 3, 0], abs=0.04)


def test_all_crops_count_alike_where_nothing_is_answered_falsely():
    assert false_answers(Brightness(), CONFIG, pool_of(NEAR, [], []), None).tolist() == [1, 2, 3]
