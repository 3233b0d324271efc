"""Ranges of the hidden layers' values on rendered pictures, which quantised inference needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import conv2d, relu

from rcdn.corners.normalise import normalise
from rcdn.synthetic import PRESETS, random_crop

COUNT, SIZE, FIRST = 400, 240, 8_000_000
"""pictures, their side in px, and the first seed"""
LEAST = 1e-3
"""range of a channel that is never active"""

Layer = tuple[Tensor, Tensor, int]
"""weights (outputs, inputs, k, k), biases (outputs,), stride"""


def ranges(layers: Sequence[Layer], normalisation: str, preset: str) -> list[list[float]]:
    """Largest value of each channel after each hidden layer (convolution and ReLU), over crops rendered with the ranges
    called `preset`."""
    top = [torch.full((len(bias),), LEAST) for _, bias, _ in layers[:-1]]
    with torch.no_grad():
        for seed in range(FIRST, FIRST + COUNT):
            image = random_crop(seed, SIZE, PRESETS[preset])[0]
            values = torch.from_numpy(np.ascontiguousarray(normalise(image, normalisation)))[None, None]
            for k, (weight, bias, stride) in enumerate(layers[:-1]):
                values = relu(conv2d(values, weight, bias, stride=stride))
                top[k] = torch.maximum(top[k], values.amax(dim=(0, 2, 3)))
    return [[round(float(v), 4) for v in values] for values in top]
