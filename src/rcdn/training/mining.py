"""Hard negatives: how often crops are drawn, by how much the network answers where there is no corner."""

from __future__ import annotations

import numpy as np
import torch

from rcdn.training.config import TrainConfig
from rcdn.training.loss import response
from rcdn.training.net import CornerNet
from rcdn.training.on_device import DevicePool
from rcdn.training.samples import Pool, cut, whole

FALSE = 0.25
"""response above which a network answers falsely where there is no corner"""
NEAR = 4
"""px; what lies so near a corner belongs to it"""
TOGETHER = 100
"""crops that the network computes together"""


@torch.no_grad()
def false_answers(net: CornerNet, config: TrainConfig, pool: Pool, there: DevicePool | None) -> torch.Tensor:
    """(N,) float64, on the processor: the cumulative sum over the crops of what `net` answers above FALSE, 1 at most a
    pixel, away from corners. All crops count alike if it answers nowhere. `there`: the pool on a graphics card, if it
    is there."""
    device, size, arch = next(net.parameters()).device, pool.images.shape[1], net.architecture
    side = size - (size - sum(arch.margins)) % arch.cell
    found = []
    for start in range(0, len(pool), TOGETHER):
        chosen = whole(np.arange(start, min(start + TOGETHER, len(pool))))
        if there is None:
            image, goal = cut(pool, chosen, arch, side, config.normalisation, config.ring)
        else:
            image, goal = there.batch(*there.numbers(chosen), side, arch.margins)
        with torch.autocast(device.type, torch.float16, enabled=device.type == "cuda"):
            z = net(image.to(device)).float()
        near = torch.nn.functional.max_pool2d(goal.positive.float().to(device), 2 * NEAR + 1, 1, NEAR) > 0
        counted = (goal.weight.to(device) > 0) & ~near
        found.append(((response(z, config.loss) - FALSE).clamp(0, 1) * counted).sum((1, 2)))
    total = torch.cat(found).double().cpu()
    return torch.cumsum(total if bool(total.sum() > 0) else torch.ones_like(total), 0)
