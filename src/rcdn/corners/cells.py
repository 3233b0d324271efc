"""The cell network (docs/decisions/0002), evaluated in a compiled kernel, and only where it is asked for."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rcdn.corners.onnx_file import Graph
from rcdn.corners.sieve import CELL
from rcdn.native import bind
from rcdn.types import Array

MARGINS = (22, 23)
"""px that the network sees before and after a cell"""
SHAPES = ((16, 1, 5, 5), (32, 16, 3, 3), *[(32, 32, 3, 3)] * 5, (16, 32, 1, 1))
"""of the weights of its convolutions: outputs, inputs, height, width"""
NODES = ("Conv", "Relu") * 7 + ("Conv", "Sigmoid", "DepthToSpace")
BAND = 16
"""rows of cells that a thread takes at least"""

_cells = bind("rcdn_network", "pfbnnF", result=True)


@dataclass(frozen=True, eq=False)
class CellNetwork:
    """A cell network's `weights`, float32, as the kernel reads them: for each layer (height, width, inputs, outputs), then the biases."""

    weights: Array

    @staticmethod
    def of(graph: Graph) -> CellNetwork | None:
        """The network of an ONNX file, or None if it is another one."""
        convolutions = [graph.inputs[k] for k, name in enumerate(graph.nodes) if name == "Conv"]
        if graph.nodes != NODES or any(len(names) != 3 for names in convolutions):
            return None
        tensors = [tuple(graph.tensors[name] for name in names[1:]) for names in convolutions]
        if tuple(weight.shape for weight, _ in tensors) != SHAPES:
            return None
        parts = [part for weight, bias in tensors for part in (weight.transpose(2, 3, 1, 0), bias)]
        return CellNetwork(np.concatenate([part.ravel() for part in parts]).astype(np.float32))

    def __call__(self, grey: Array, cells: Array, threads: int = 0) -> Array:
        """Response (H, W) float32 of `grey` (H, W), uint8 or float32 in 0..255: of `cells` (⌈H/4⌉, ⌈W/4⌉) bool, 0 elsewhere.

        The picture is continued by reflection. `threads`: 0 = all cores. What is computed depends neither on them nor on the other cells.
        """
        height = len(cells)
        out = np.zeros(grey.shape, np.float32)
        grey, mask = np.ascontiguousarray(grey), np.ascontiguousarray(cells).view(np.uint8)
        assert mask.shape == tuple(-(-n // CELL) for n in grey.shape)
        count = max(1, min(threads or os.cpu_count() or 1, height // BAND))
        edges = np.linspace(0, height, count + 1).astype(int).tolist()

        def run(band: tuple[int, int]) -> None:
            if _cells(grey, self.weights, mask, band[0], band[1] - band[0], out) < 0:
                raise MemoryError("network: no memory for its rows")

        bands = list(pairwise(edges))
        if count > 1:
            with ThreadPoolExecutor(count) as pool:
                list(pool.map(run, bands))
        else:
            run(bands[0])
        return out
