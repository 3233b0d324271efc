"""The loss of Eq. 1–2 in two forms, the one-sided squared loss of MATE, and the heat-map loss of `auto`.

Every loss takes the pre-activation z (B, h, w) of the last layer and `Targets`, and returns a scalar. Those of
`BALANCED` also take `background`: how many times the background's mean counts; in Eq. 1 once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

EPS = 1e-6
KNEE = 0.05
"""response below which (for negatives: above 1 − KNEE) the form `safe` continues as a straight line"""


class Targets(NamedTuple):
    """Maps (B, h, w): `positive` bool, one pixel per corner; `weight`, 0 excludes a pixel; `heat` in 0..1."""

    positive: Tensor
    weight: Tensor
    heat: Tensor


def _balanced(positive_terms: Tensor, negative_terms: Tensor, targets: Targets, background: float) -> Tensor:
    """Mean over the positives plus `background` times the mean over the negatives, both over the whole batch."""
    pos = targets.positive & (targets.weight > 0)
    neg = ~targets.positive & (targets.weight > 0)
    zero = torch.zeros((), dtype=positive_terms.dtype, device=positive_terms.device)
    return torch.where(pos, positive_terms, zero).sum() / pos.sum().clamp(min=1) + background * torch.where(
        neg, negative_terms, zero
    ).sum() / neg.sum().clamp(min=1)


def paper(z: Tensor, targets: Targets, background: float = 1.0) -> Tensor:
    """Eq. 1 on the clipped output of Eq. 2; its regulariser is the optimiser's weight decay. Its gradient can vanish
    for good (a dead network): see `safe`."""
    y = torch.relu(z)
    a_pos, a_neg = y.clamp(EPS, 1.0), y.clamp(0.0, 1.0 - EPS)
    return _balanced(-(1 - a_pos) * a_pos.log(), -a_neg * torch.log1p(-a_neg), targets, background)


def _hinge(a: Tensor) -> Tensor:
    """−(1 − a) ln a for a ≥ KNEE, 0 from 1 on, and its tangent below KNEE."""
    inner = a.clamp(KNEE, 1.0)
    curve = -(1 - inner) * inner.log()
    knee = torch.full((), KNEE, dtype=a.dtype, device=a.device)
    value, slope = -(1 - knee) * knee.log(), knee.log() - (1 - knee) / knee
    return torch.where(a < KNEE, value + slope * (a - KNEE), curve)


def safe(z: Tensor, targets: Targets, background: float = 1.0) -> Tensor:
    """Eq. 1–2 on the pre-activation, continued as a straight line below 0.05 (corners) and above 0.95 (background).

    It has the same minimiser as `paper` and is one-sided, too; the gradient is bounded and never zero for a missed
    corner.
    """
    return _balanced(_hinge(z), _hinge(1 - z), targets, background)


def squared(z: Tensor, targets: Targets, background: float = 1.0) -> Tensor:
    """MATE's one-sided squared difference, weighted by inverse class frequency (paper section 3.2).

    It acts on the pre-activation, so that a missed corner has a gradient even below 0, where the response is 0.
    """
    return _balanced((1 - z).clamp(min=0) ** 2, torch.relu(z) ** 2, targets, background)


def heatmap(z: Tensor, targets: Targets) -> Tensor:
    """Quality focal loss (Li et al. 2020, β = 1.5) against a Gaussian of σ = 1 px at the exact corner.

    The response is sigmoid(z).
    """
    gap = (targets.heat - torch.sigmoid(z)).abs() ** 1.5
    bce = torch.nn.functional.binary_cross_entropy_with_logits(z, targets.heat, reduction="none")
    return (gap * bce * targets.weight).sum() / targets.positive.sum().clamp(min=1)


LOSSES: dict[str, Callable[..., Tensor]] = {
    "paper": paper, "safe": safe, "squared": squared, "heatmap": heatmap,
}  # fmt: skip
BALANCED = ("paper", "safe", "squared")
"""Losses that are a mean over the corners plus a mean over the background."""
ACTIVATION = {"paper": "relu", "safe": "relu", "squared": "relu", "heatmap": "sigmoid"}
"""Final activation, by loss: converts z of a network trained with this loss into the response."""


def loss_function(name: str, background: float = 1.0) -> Callable[[Tensor, Targets], Tensor]:
    """The loss `name`; the background's mean counts `background` times."""
    return partial(LOSSES[name], background=background) if name in BALANCED else LOSSES[name]


def response(z: Tensor, loss: str) -> Tensor:
    """The response of a network trained with `loss`, from its pre-activation."""
    return torch.relu(z) if ACTIVATION[loss] == "relu" else torch.sigmoid(z)
