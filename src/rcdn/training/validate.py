"""Scores of a network on fixed rendered crops that are not used in training."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from rcdn.corners.normalise import normalise
from rcdn.synthetic import PRESETS
from rcdn.training.config import TrainConfig
from rcdn.training.loss import ACTIVATION
from rcdn.training.samples import Pool
from rcdn.types import Array
from rcdn.validation import score_crop, summary, validation_set


def torch_response(net: Any, image: Array, loss: str, kind: str) -> Array:
    """Response map (H, W) of a picture, by torch, with the same padding by reflection as in inference."""
    before, after = net.architecture.margins
    h, w = image.shape
    cell = net.architecture.cell
    pad_h, pad_w = -h % cell, -w % cell
    grey = np.pad(normalise(image, kind), ((before, after + pad_h), (before, after + pad_w)), mode="reflect")
    device = next(net.parameters()).device
    with torch.no_grad():
        z = net(torch.from_numpy(grey)[None, None].to(device))[0, :h, :w]
    response = torch.relu(z) if ACTIVATION[loss] == "relu" else torch.sigmoid(z)
    return np.asarray(response.cpu().numpy())


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
    return summary([score_crop(torch_response(net, im, config.loss, config.normalisation), lab) for im, lab in samples])
