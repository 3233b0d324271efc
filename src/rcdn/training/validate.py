"""How good a network is on fixed rendered crops that training never sees."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch

from rcdn.config import Nms
from rcdn.corners.nms import nms
from rcdn.corners.normalise import normalise
from rcdn.metrics import best_f1, match
from rcdn.synthetic import HARD, random_crop
from rcdn.training.config import TrainConfig
from rcdn.training.loss import ACTIVATION
from rcdn.training.samples import Pool
from rcdn.types import Array

COUNT, SIZE, FIRST, BORDER, RADIUS = 400, 144, 9_000_000_000, 8, 2.0
"""400 crops of 144 px of the ranges HARD; corners within 8 px of the rim don't count; 2 px to match"""


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
    """F1 at the best threshold, its precision and recall, that threshold, and the mean distance of peaks to the exact corners, px."""
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
    """(score of each peak, whether it hits, distances of the hits, number of corners) of one crop; doubtful corners don't count."""
    xy, score = nms(response, least, Nms(5))
    xy = xy.astype(float)
    edge = np.array(response.shape[::-1]) - 1 - BORDER
    sure = labels[:, 2] > 0
    corners, doubtful = labels[sure, :2], labels[~sure, :2]
    pairs, _ = match(xy, corners, RADIUS)
    hit = np.zeros(len(xy), bool)
    hit[pairs[:, 0]] = True
    inside = (xy >= BORDER).all(axis=1) & (xy <= edge).all(axis=1)
    counted = ((corners >= BORDER) & (corners <= edge)).all(axis=1)
    drop = np.zeros(len(xy), bool)
    if len(doubtful):
        drop = (np.linalg.norm(xy[:, None] - doubtful[None], axis=2) < 4).any(axis=1) & ~hit
    outside_hit = np.zeros(len(xy), bool)
    outside_hit[pairs[~counted[pairs[:, 1]], 0]] = True
    inside_hit = np.zeros(len(xy), bool)
    inside_hit[pairs[counted[pairs[:, 1]], 0]] = True
    keep = ((inside & ~hit & ~drop) | inside_hit) & ~outside_hit
    gap = np.linalg.norm(xy[pairs[:, 0]] - corners[pairs[:, 1]], axis=1)[counted[pairs[:, 1]]]
    return score[keep], hit[keep], gap, int(counted.sum())
