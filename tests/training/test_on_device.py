"""Batches cut on a device are those cut on the processor; a step recorded as a CUDA graph is the step itself."""

from __future__ import annotations

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import numpy as np
import torch

from rcdn.training.net import ARCHITECTURES
from rcdn.training.on_device import DevicePool, Recorded
from rcdn.training.samples import PoolConfig, cut, make_pool, whole, windows


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    return make_pool(PoolConfig(count=12, size=112, ranges="hard", seed=3), tmp_path_factory.mktemp("pool"), workers=1)


@pytest.mark.parametrize(("name", "side", "kind", "ring"), [("E", 80, "minmax", True), ("Q", 109, "local", False)])
def test_a_window_is_the_same_cut_there_and_here(pool, name, side, kind, ring):
    arch = ARCHITECTURES[name]
    there = DevicePool(pool, kind, ring, True, torch.device("cpu"))
    for seed in range(4):
        chosen = windows(len(pool), 112 - side, 20, kind, (seed,))
        image, goal = cut(pool, chosen, arch, side, kind, ring)
        again, maps = there.batch(*there.numbers(chosen), side, arch.margins)
        assert torch.allclose(image, again, atol=2e-4)  # local contrast of the inverted levels rounds otherwise
        assert torch.equal(goal.positive, maps.positive)
        assert goal.positive.any()
        assert torch.equal(goal.weight, maps.weight)
        assert (goal.weight == 0).any()
        assert torch.allclose(goal.heat, maps.heat, atol=5e-4)


def test_whole_crops_are_neither_turned_nor_cut(pool):
    there = DevicePool(pool, "minmax", True, False, torch.device("cpu"))
    image, goal = there.batch(*there.numbers(whole(np.arange(3, 6))), 112, (0, 0))
    expected, _ = cut(pool, whole(np.arange(3, 6)), ARCHITECTURES["E"], 112, "minmax", True)
    assert torch.equal(image, expected)
    assert goal.positive.shape == (3, 112, 112)


def test_every_second_window_is_drawn_by_its_crops_probability():
    often = np.cumsum([0.0, 0.0, 3.0, 0.0, 1.0])
    counts = np.zeros((2, 5))
    for seed in range(400):
        crop = windows(5, 4, 10, "minmax", (seed,), often).crop
        for k in range(2):
            counts[k] += np.bincount(crop[k::2], minlength=5)
    assert counts[0, [0, 1, 3]].sum() == 0
    assert counts[0, 2] / counts[0].sum() == pytest.approx(0.75, abs=0.04)
    assert np.abs(counts[1] / counts[1].sum() - 0.2).max() < 0.04


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a graphics card")
def test_a_recorded_step_is_the_step():
    net = torch.nn.Sequential(torch.nn.Conv2d(1, 4, 3), torch.nn.BatchNorm2d(4)).cuda()
    parameters, buffers = list(net.parameters()), list(net.buffers())

    def work(image):
        for parameter in parameters:
            parameter.grad = None
        loss = (net(image) ** 2).mean() + net[0].bias.sum()
        loss.backward()
        return loss.detach()

    images = torch.rand(3, 2, 1, 16, 16, device="cuda")
    before = [b.clone() for b in buffers]
    recorded = Recorded(work, (images[0],), buffers)
    assert all(torch.equal(a, b) for a, b in zip(before, buffers, strict=True))
    found = [float(recorded(image)) for image in images]
    gradient = parameters[0].grad.clone()
    assert found == pytest.approx([float(work(image)) for image in images], rel=1e-3)
    assert torch.allclose(gradient, parameters[0].grad, rtol=1e-2, atol=1e-4)
