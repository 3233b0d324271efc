"""Training on one graphics card: the pool lies in its memory, batches are cut there, and a step is one CUDA graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rcdn.corners.normalise import normalise, normaliser
from rcdn.training.loss import Targets
from rcdn.training.samples import Pool, Windows, painted

CHUNK = 1000
"""crops whose maps are computed together"""
BACKGROUND, CORNER, EXCLUDED = 0, 1, 2


class DevicePool:
    """A pool in the memory of `device`, and the maps of its labels. Memory: N·S² bytes for each of pictures and marks;
    with `heat` 2 more a pixel, with local contrast 4 more."""

    def __init__(self, pool: Pool, kind: str, ring: bool, heat: bool, device: torch.device) -> None:
        count, self.size, _ = pool.images.shape
        self.kind, self.device = kind, device
        self.images = torch.from_numpy(pool.images).to(device).reshape(-1)
        self.marks = torch.empty(self.images.shape, dtype=torch.uint8, device=device)
        self.heat = torch.empty(self.images.shape if heat else 0, dtype=torch.float16, device=device)
        for start in range(0, count, CHUNK):
            self._mark(pool.labels[start : start + CHUNK], start, ring)
        self.low, self.scale, self.local = torch.empty(0), torch.empty(0), torch.empty(0)
        if kind == "minmax":
            levels = [[_levels(image), _levels(255 - image)] for image in pool.images]
            self.low, self.scale = torch.tensor(levels, device=device).unbind(2)
        else:
            self.local = torch.empty(self.images.shape, device=device).view(count, -1)
            for k, image in enumerate(pool.images):
                self.local[k] = torch.from_numpy(normalise(image, kind).reshape(-1)).to(device)
            self.local = self.local.view(-1)

    def _mark(self, labels: Any, start: int, ring: bool) -> None:
        """Fill the maps of the crops from `start` on."""
        owner, row = np.nonzero(np.isfinite(labels[:, :, 0]))
        places = torch.from_numpy(labels[owner, row].astype(float)).to(self.device)
        shape = (len(labels), self.size, self.size)
        positive, weight, heat = painted(torch.from_numpy(owner).to(self.device), places, shape, ring)
        marks = torch.where(positive, CORNER, torch.where(weight > 0, BACKGROUND, EXCLUDED)).to(torch.uint8)
        area = slice(start * self.size**2, (start + len(labels)) * self.size**2)
        self.marks[area] = marks.reshape(-1)
        if len(self.heat):
            self.heat[area] = heat.reshape(-1).half()

    def numbers(self, chosen: Windows) -> tuple[Tensor, Tensor]:
        """`chosen` as two tensors on the device, which `batch` takes."""
        whole = np.column_stack([chosen.crop, chosen.corner, chosen.turn])
        real = np.column_stack([chosen.span, chosen.base])
        return torch.from_numpy(whole).to(self.device), torch.from_numpy(real).to(self.device)

    def batch(self, whole: Tensor, real: Tensor, side: int, margins: tuple[int, int]) -> tuple[Tensor, Targets]:
        """As `samples.cut`: pictures (n, 1, side, side) and maps without the network's `margins`."""
        crop, x, y, mirrored, upside_down, transposed, inverted = (c[:, None, None] for c in whole.unbind(1))
        step, last = torch.arange(side, device=self.device), self.size - 1
        row, column = (y + step[:, None]).expand(-1, -1, side), (x + step).expand(-1, side, -1)
        turned = transposed > 0
        row, column = torch.where(turned, column, row), torch.where(turned, row, column)
        row = torch.where(upside_down > 0, last - row, row)
        column = torch.where(mirrored > 0, last - column, column)
        place = (crop * self.size + row) * self.size + column
        grey = self._grey(place, crop, inverted)
        span, base = (c[:, None, None] for c in real.unbind(1))
        before, after = margins
        inner = place[:, before : side - after, before : side - after]
        marks = self.marks[inner]
        heat = self.heat[inner].float() if len(self.heat) else torch.zeros_like(marks, dtype=torch.float32)
        return (grey * span + base)[:, None], Targets(marks == CORNER, (marks != EXCLUDED).float(), heat)

    def _grey(self, place: Tensor, crop: Tensor, inverted: Tensor) -> Tensor:
        if self.kind == "local":
            return self.local[place] * (1 - 2 * inverted).float()
        level = self.images[place].float()
        level = torch.where(inverted > 0, 255 - level, level)
        return (level - self.low[crop, inverted]) * self.scale[crop, inverted]


def _levels(image: Any) -> tuple[float, float]:
    """The level that becomes 0, and the factor, of `minmax`."""
    found = normaliser(image, "minmax")
    return found.low, 1.0 / (found.high - found.low) if found.high > found.low else 0.0


class Recorded:
    """`work`, recorded as a CUDA graph with tensors of the shapes of `example`: all kernels that it starts then start
    as one, so that the card, not the processor, says how long a small network's step takes. `kept`: tensors that have
    the values again which they had before `work` was tried."""

    def __init__(self, work: Callable[..., Any], example: tuple[Tensor, ...], kept: list[Tensor]) -> None:
        self.inputs = [t.clone() for t in example]
        before = [t.clone() for t in kept]
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(3):  # cuDNN chooses its algorithms, memory is reserved
                work(*self.inputs)
        torch.cuda.current_stream().wait_stream(side)
        self.graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self.graph):
            self.outputs = work(*self.inputs)
        for tensor, value in zip(kept, before, strict=True):
            tensor.copy_(value)

    def __call__(self, *tensors: Tensor) -> Any:
        for mine, new in zip(self.inputs, tensors, strict=True):
            mine.copy_(new, non_blocking=True)
        self.graph.replay()
        return self.outputs
