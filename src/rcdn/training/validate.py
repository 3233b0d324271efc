"""How good a network is on fixed rendered crops that training never sees."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch

from rcdn.config import Nms
from rcdn.corners.nms import nms
from rcdn.corners.normalise import normalise
from rcdn.metrics import best_f1, match, nearest
from rcdn.synthetic import HARD, random_crop
from rcdn.training.config import TrainConfig
from rcdn.training.loss import ACTIVATION
from rcdn.training.samples import Pool
from rcdn.types import Array

COUNT, SIZE, FIRST, BORDER, RADIUS, DOUBT = 400, 144, 9_000_000_000, 8, 2.0, 4.0
"""400 crops of 144 px of the ranges HARD; the rim of 8 px doesn't count; 2 px to match; 4 px around doubtful corners"""


@lru_cache(maxsize=1)
def validation_set(count: int = COUNT) -> tuple[tuple[Array, Array], ...]:
    """(picture, labels) of the fixed hard validation set; no photographs in it, so that anybody can make it."""
    return tuple(random_crop(FIRST + k, SIZE, HARD) for k in range(count))


def torch_response(net: Any, image: Array, loss: str, kind: str) -> Array:
    """Response map (H, W) of a picture, by torch, padded by reflection as inference does it."""
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
    """F1 at the best threshold, its precision and recall, that threshold, average precision, and `pixel_error`.

    `pixel_error`: mean distance of the peaks to the exact corners, px; NaN if no peak hits.
    """
    net.eval()
    samples: Any
    if overfit is None:
        samples = validation_set()
    else:
        samples = [(im, lab[np.isfinite(lab[:, 0])]) for im, lab in zip(overfit.images, overfit.labels, strict=True)]
    rows = [score_crop(torch_response(net, im, config.loss, config.normalisation), lab) for im, lab in samples]
    scores, hits, gaps = (np.concatenate([row[k] for row in rows]) for k in range(3))
    error = round(float(gaps.mean()), 4) if len(gaps) else float("nan")
    return best_f1(scores, hits, sum(row[3] for row in rows)) | {"pixel_error": error}


def score_crop(response: Array, labels: Array, least: float = 0.05) -> tuple[Array, Array, Array, int]:
    """(score of each peak, whether it hits, distances of the hits, number of corners) of one crop.

    What counts is inside the rim: corners there with the peaks that match them, and peaks there that match none. A peak
    at a doubtful corner or at a corner in the rim is neither right nor wrong.
    """
    xy, score = nms(response, least, Nms(5))
    sure = labels[:, 2] > 0
    corners, doubtful = labels[sure, :2], labels[~sure, :2]
    counted = _inside(corners, response.shape)
    pairs, gaps = match(xy, corners, RADIUS)
    good = counted[pairs[:, 1]]
    hit, paired = np.zeros(len(xy), bool), np.zeros(len(xy), bool)
    hit[pairs[good, 0]], paired[pairs[:, 0]] = True, True
    keep = hit | (_inside(xy, response.shape) & ~paired & ~nearest(xy, doubtful, DOUBT))
    return score[keep], hit[keep], gaps[good], int(counted.sum())


def _inside(xy: Array, shape: tuple[int, ...]) -> Array:
    """Which of `xy` (N, 2) lie inside the rim."""
    return np.asarray(((xy >= BORDER) & (xy <= np.array(shape[::-1]) - 1 - BORDER)).all(axis=1))
