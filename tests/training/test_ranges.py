"""Ranges of hidden layers, against convolutions written out in NumPy."""

from __future__ import annotations

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import numpy as np
import torch

from rcdn.corners.normalise import normalise
from rcdn.synthetic import PRESETS, random_crop
from rcdn.training import export as module
from rcdn.training.export import ranges


def convolved(values, weight, bias, stride):
    """(inputs, H, W) → (outputs, h, w), one tap at a time, then ReLU."""
    outputs, _, side, _ = weight.shape
    h, w = ((n - side) // stride + 1 for n in values.shape[1:])
    out = np.zeros((outputs, h, w)) + bias[:, None, None]
    for j in range(side):
        for i in range(side):
            seen = values[:, j : j + stride * h : stride, i : i + stride * w : stride]
            out += np.einsum("oc,chw->ohw", weight[:, :, j, i], seen)
    return np.maximum(out, 0)


def expected(layers, normalisation, preset, count, size):
    top = [np.full(len(bias), module.LEAST_RANGE) for _, bias, _ in layers[:-1]]
    for seed in range(module.FIRST, module.FIRST + count):
        values = normalise(random_crop(seed, size, PRESETS[preset])[0], normalisation)[None].astype(float)
        for k, layer in enumerate(layers[:-1]):
            values = convolved(values, *layer)
            top[k] = np.maximum(top[k], values.max(axis=(1, 2)))
    return top


@pytest.fixture
def layers():
    """Three convolutions: one with a stride, one with a channel that is never used, the last one hidden from ranges."""
    rng = np.random.default_rng(1)
    shapes = [(3, 1, 5, 5, 2), (4, 3, 3, 3, 1), (2, 4, 1, 1, 1)]
    out = [(rng.normal(0, 0.3, shape[:4]), rng.normal(0, 0.2, shape[0]), shape[4]) for shape in shapes]
    out[1][1][2] = -1e3
    return out


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(module, "PICTURES", 3)
    monkeypatch.setattr(module, "SIDE", 48)


def as_tensors(layers):
    return [(torch.tensor(w, dtype=torch.float32), torch.tensor(b, dtype=torch.float32), s) for w, b, s in layers]


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize(("normalisation", "preset"), [("local", "training"), ("minmax", "paper")])
def test_ranges_are_the_largest_values(layers, normalisation, preset):
    found, known = ranges(as_tensors(layers), normalisation, preset), expected(layers, normalisation, preset, 3, 48)
    assert [len(values) for values in found] == [3, 4]
    for values, right in zip(found, known, strict=True):
        np.testing.assert_allclose(values, right, atol=2e-4, rtol=1e-5)
    assert found[1][2] == module.LEAST_RANGE
    assert min(found[0]) > 0.05


@pytest.mark.usefixtures("few")
def test_more_pictures_make_no_range_smaller(layers, monkeypatch):
    three = ranges(as_tensors(layers), "local", "training")
    monkeypatch.setattr(module, "PICTURES", 6)
    six = ranges(as_tensors(layers), "local", "training")
    assert all(b >= a for one, two in zip(three, six, strict=True) for a, b in zip(one, two, strict=True))
    assert six != three


@pytest.mark.usefixtures("few")
def test_the_same_ranges_every_time(layers):
    one, two = (ranges(as_tensors(layers), "local", "training") for _ in range(2))
    assert one == two
