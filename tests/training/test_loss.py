"""Losses: values and gradients by hand (paper Eq. 1–2)."""

from __future__ import annotations

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import numpy as np
import torch

from rcdn.training.loss import ACTIVATION, BALANCED, LOSSES, Targets, heatmap, loss_function, paper, safe, squared

F64 = torch.float64
GRID = [0.051, 0.1, 0.3, 0.5, 0.8, 0.949]  # between the knees, where `safe` is `paper`


def corner(z, positives=1, weight=None):
    """z (N,) as a picture of one row, whose first `positives` pixels are corners."""
    z = torch.as_tensor(z, dtype=F64).reshape(1, 1, -1).requires_grad_()
    mask = torch.zeros(z.shape, dtype=torch.bool)
    mask[..., :positives] = True
    seen = torch.ones(z.shape, dtype=F64) if weight is None else torch.as_tensor(weight, dtype=F64).reshape(z.shape)
    return z, Targets(mask, seen, mask.to(F64))


def value(loss, z, **kw):
    z, targets = corner(z, **kw)
    return float(loss(z.detach(), targets))


def slopes(loss, z, **kw):
    z, targets = corner(z, **kw)
    loss(z, targets).backward()
    return z.grad.ravel().tolist()


@pytest.mark.parametrize("loss", [paper, safe])
@pytest.mark.parametrize("a", GRID)
def test_values_and_gradients_by_hand(loss, a):
    expected = -((1 - a) * np.log(a) + 0.5 * np.log(0.5)) / 2 - (2 * a * np.log(1 - a) + 0.2 * np.log(0.8)) / 3
    assert value(loss, [a, 0.5, a, a, 0.2], positives=2) == pytest.approx(expected, abs=1e-12)
    grad = slopes(loss, [a, 0.5, a, a, 0.2], positives=2)
    assert grad[0] == pytest.approx((np.log(a) - (1 - a) / a) / 2, abs=1e-12)
    assert grad[2] == pytest.approx((a / (1 - a) - np.log(1 - a)) / 3, abs=1e-12)


@pytest.mark.parametrize("loss", [paper, safe])
def test_no_gradient_beyond_the_target(loss):
    """A corner above 1 and background below 0 are right: one-sided."""
    assert slopes(loss, [1.2, -0.3]) == [0, 0]
    assert value(loss, [1.2, -0.3]) == 0


def test_paper_is_flat_outside_its_clip():
    assert slopes(paper, [-0.1, 0.5])[0] == 0  # a dead corner
    assert slopes(paper, [5e-7, 0.5])[0] == 0
    assert slopes(paper, [0.5, 1.0])[1] == 0
    assert slopes(paper, [2e-6, 0.5])[0] == pytest.approx(np.log(2e-6) - (1 - 2e-6) / 2e-6)


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_an_output_of_zeros_is_the_dead_value(value):
    z = torch.full((1, 8, 8), value)  # float32, as in training
    positive = torch.zeros(z.shape, dtype=torch.bool)
    positive[0, 3, 4] = True
    targets = Targets(positive, torch.ones(z.shape), positive.float())
    assert float(paper(z, targets)) == pytest.approx(-np.log(1e-6), abs=2e-4)


@pytest.mark.parametrize(("sign", "knee"), [(-1, 0.05), (1, 0.95)])
def test_safe_is_smooth_at_its_knees(sign, knee):
    """Value and slope are those of `paper` on one side and go on unchanged on the other."""
    index = 0 if sign < 0 else 1  # corner below 0.05, background above 0.95
    other = 1.5 if sign > 0 else -1.0  # the other pixel costs nothing

    def at(a):
        pair = [a, other] if index == 0 else [other, a]
        return value(safe, pair), slopes(safe, pair)[index]

    inner, outer = at(knee - sign * 1e-7), at(knee + sign * 1e-7)
    assert outer[0] - inner[0] == pytest.approx(22 * 2e-7, rel=1e-2)
    assert abs(outer[1] - inner[1]) < 1e-4
    assert abs(inner[1]) == pytest.approx(19 - np.log(0.05), abs=1e-4)  # 21.996
    far = at(knee + sign * 30.0)
    assert far[1] == outer[1]
    assert far[0] == pytest.approx(outer[0] + 30 * (19 - np.log(0.05)), abs=1e-4)


def test_safe_never_gives_up_a_missed_corner():
    z = torch.linspace(-50, 0.999, 400, dtype=F64)
    grad = torch.tensor([slopes(safe, [float(v), 0.0])[0] for v in z[::8]])
    assert (grad < 0).all()
    assert grad.min() >= -22
    grad = torch.tensor([slopes(safe, [1.0, 1 - float(v)])[1] for v in z[::8]])
    assert (grad > 0).all()
    assert grad.max() <= 22


def test_squared_is_one_sided():
    assert value(squared, [0.4, 0.3, -0.2]) == pytest.approx(0.36 + 0.09 / 2)
    assert slopes(squared, [0.4, 0.3, -0.2]) == pytest.approx([-1.2, 0.3, 0])
    assert slopes(squared, [1.5, -2.0]) == [0, 0]
    assert slopes(squared, [-1.0, 0.0])[0] == pytest.approx(-4)  # a corner below 0 isn't lost


@pytest.mark.parametrize("loss", [paper, safe, squared])
def test_classes_weigh_the_same_however_many_pixels_they_have(loss):
    one = value(loss, [0.3, 0.6])
    assert value(loss, [0.3] * 3 + [0.6] * 50, positives=3) == pytest.approx(one)


@pytest.mark.parametrize("name", BALANCED)
def test_the_background_counts_as_often_as_told(name):
    """Three times: the loss of the corners and three times that of the background, which are seen one at a time."""
    loss = loss_function(name, 3.0)
    corners, background = value(loss, [0.3, -2.0]), value(loss, [9.0, 0.6])  # the other pixel costs nothing
    assert corners == pytest.approx(value(LOSSES[name], [0.3, -2.0]))
    assert background == pytest.approx(3 * value(LOSSES[name], [9.0, 0.6]))
    assert value(loss, [0.3, 0.6]) == pytest.approx(corners + background)


@pytest.mark.parametrize("name", LOSSES)
def test_a_batch_without_corners(name):
    z, targets = corner([0.2, 0.4], positives=0)
    result = LOSSES[name](z, targets)
    result.backward()
    assert torch.isfinite(result)
    assert (z.grad > 0).all()
    if name != "heatmap":
        assert float(result.detach()) == pytest.approx(value(LOSSES[name], [9.0, 0.2, 0.4]))


@pytest.mark.parametrize("name", LOSSES)
def test_nothing_where_the_weight_is_zero(name):
    weight = [1.0, 1.0, 0.0]
    low, high = (value(LOSSES[name], [0.3, 0.6, v], weight=weight) for v in (0.1, 0.9))
    assert low == high
    assert slopes(LOSSES[name], [0.3, 0.6, 0.9], weight=weight)[2] == 0
    if name != "heatmap":
        assert low == pytest.approx(value(LOSSES[name], [0.3, 0.6]))


def test_heatmap_is_least_at_its_target():
    heat = torch.tensor([1.0, 0.6, 0.2, 0.01], dtype=F64)
    _, targets = corner(heat)
    targets = targets._replace(heat=heat.reshape(1, 1, -1))
    best = torch.logit(heat.clamp(max=1 - 1e-9)).reshape(1, 1, -1)
    least = float(heatmap(best, targets))
    assert least < 1e-8
    for k in range(4):
        for step in (-0.3, 0.3) if k else (-25.0,):
            moved = best.clone()
            moved[..., k] += step
            assert float(heatmap(moved, targets)) > least + 1e-6
    assert value(heatmap, [0.0, 0.0]) == pytest.approx(2 * 0.5**1.5 * np.log(2))  # |1 − ½|^1.5 · ln 2, twice


def test_every_loss_says_what_its_response_is():
    assert set(ACTIVATION) == set(LOSSES)
