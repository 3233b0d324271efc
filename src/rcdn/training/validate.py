"""Scores of a network on fixed rendered crops that are not used in training."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from rcdn.corners.normalise import normalise
from rcdn.synthetic import PRESETS
from rcdn.training.config import TrainConfig
from rcdn.training.loss import response
from rcdn.training.samples import Pool
from rcdn.types import Array
from rcdn.validation import score_crop, summary, validation_set

TOGETHER = 20
"""crops that a network computes together"""


def torch_response(net: Any, image: Array, loss: str, kind: str) -> Array:
    """Response map (H, W) of a picture, by torch, with the same padding by reflection as in inference."""
    return torch_responses(net, [image], loss, kind)[0]


def torch_responses(net: Any, images: list[Array], loss: str, kind: str) -> Array:
    """As `torch_response`, of pictures of one size: (N, H, W)."""
    before, after = net.architecture.margins
    h, w = images[0].shape
    cell = net.architecture.cell
    room = ((before, after + -h % cell), (before, after + -w % cell))
    grey = np.stack([np.pad(normalise(image, kind), room, mode="reflect") for image in images])
    device = next(net.parameters()).device
    with torch.no_grad():
        z = net(torch.from_numpy(grey)[:, None].to(device))[:, :h, :w]
    return np.asarray(response(z, loss).cpu().numpy())


def validate(net: Any, config: TrainConfig, overfit: Pool | None = None) -> dict[str, float]:
    """`validation.summary` of a network on the hard validation set, or on the crops of `overfit`.

    A network for deltilles is evaluated on crops with the ranges of its training data, since it must not respond to
    X-corners.
    """
    net.eval()
    samples: Any
    ranges = PRESETS[config.pool.ranges]
    if overfit is None:
        samples = validation_set(ranges=ranges) if ranges.deltille_p else validation_set()
    else:
        samples = [(im, lab[np.isfinite(lab[:, 0])]) for im, lab in zip(overfit.images, overfit.labels, strict=True)]
    scores = []
    for start in range(0, len(samples), TOGETHER):
        some = samples[start : start + TOGETHER]
        responses = torch_responses(net, [image for image, _ in some], config.loss, config.normalisation)
        scores += [score_crop(found, labels) for found, (_, labels) in zip(responses, some, strict=True)]
    return summary(scores)
