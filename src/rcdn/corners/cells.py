"""The cell network (docs/decisions/0002), evaluated by a compiled kernel, and only in the cells that are requested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from rcdn.corners.onnx_file import Graph
from rcdn.corners.sieve import CELL
from rcdn.corners.threads import Threads, cores
from rcdn.errors import RcdnError
from rcdn.native import bind, constants
from rcdn.types import Array

SHAPES = ((16, 1, 5, 5), (32, 16, 3, 3), *[(32, 32, 3, 3)] * 5, (16, 32, 1, 1))
"""shapes of the weights of its convolutions: outputs, inputs, height, width"""
NODES = ("Conv", "Relu") * 7 + ("Conv", "Sigmoid", "DepthToSpace")
STRIDES = (2, 2, 1, 1, 1, 1, 1, 1)
"""strides of its convolutions"""
BAND = 16
"""least number of rows of cells per thread"""

LEVELS, WEIGHT_LEVELS = np.iinfo(np.uint8).max, np.iinfo(np.int8).max
"""largest quantised activation and weight"""
LARGEST_WEIGHT, LEAST_WEIGHT = 1e6, 1e-30
"""largest magnitude of a weight, and the least value used as an output's largest weight, which avoids a division by
0"""
GROUP = constants("network")["GROUP"]
"""input channels that the kernel multiplies together"""
BEST = constants("network")["BEST"]
"""instructions that the kernel uses, if the processor has them: 2 dot products of bytes, 1 vectors, 0 plain C's"""

_network = bind("rcdn_network")


@dataclass(frozen=True, eq=False)
class CellNetwork:
    """A cell network's weights as the kernel reads them: `reals` float32, `whole` int8; `pool`: the threads that it
    runs on.

    Activations of hidden layers are integers 0..255, one unit of which is a channel's largest value on rendered
    pictures (`ranges`) ÷ 255; weights have 8 bits, with one scale per output. Export computes, tests and stores them
    (`quantised.py`). Responses above .3 differ from those of the floating-point network by .005 in the mean.
    """

    reals: Array
    whole: Array
    pool: Threads = field(default_factory=Threads, repr=False)

    @staticmethod
    def fits(graph: Graph) -> bool:
        """Whether the graph has the architecture that the kernel implements."""
        return (
            graph.nodes == NODES and all(len(names) == 3 for names in _convolutions(graph)) and _shapes(graph) == SHAPES
        )

    @staticmethod
    def of(graph: Graph, ranges: Sequence[Sequence[float]] | None, pool: Threads | None = None) -> CellNetwork | None:
        """The network of an ONNX file, given the largest values `ranges` of its hidden layers' channels.

        None if it has another architecture, or if the ranges are unknown.
        """
        if ranges is None or not CellNetwork.fits(graph):
            return None
        tensors = [(graph.tensors[weight], graph.tensors[bias]) for _, weight, bias in _convolutions(graph)]
        unit = units(ranges)
        if not all((np.abs(tensor) <= LARGEST_WEIGHT).all() for pair in tensors for tensor in pair):
            raise RcdnError(f"model: its weights must be finite and within ±{LARGEST_WEIGHT:g}")
        weight, bias = tensors[0]
        reals, whole = [weight.transpose(2, 3, 1, 0) / unit[0], bias / unit[0]], []
        for k, (weight, bias) in enumerate(tensors[1:]):
            weight = weight * unit[k][:, None, None]
            scale = np.maximum(np.abs(weight).max(axis=(1, 2, 3)), LEAST_WEIGHT) / WEIGHT_LEVELS
            levels = np.rint(weight / scale[:, None, None, None]).astype(np.int8)
            after = unit[k + 1] if k + 1 < len(unit) else 1.0
            reals += [scale / after, bias / after]
            if k + 1 < len(unit):
                whole.append(_grouped(levels))
            else:
                reals.append(levels[:, :, 0, 0].T)
        flat = np.concatenate([r.ravel() for r in reals]).astype(np.float32)
        return CellNetwork(flat, np.concatenate(whole), pool or Threads())

    def __call__(self, grey: Array, cells: Array, threads: int = 0, instructions: int = BEST) -> Array:
        """Response (H, W) float32 of `grey` (H, W), uint8 or float32 in 0..255: of `cells` (⌈H/4⌉, ⌈W/4⌉) bool, 0
        elsewhere.

        The picture is extended by reflection. `threads`: 0 = all cores. The response of a cell depends neither on the
        number of threads nor on the other cells. `instructions`: as `BEST`.
        """
        height = len(cells)
        out = np.zeros(grey.shape, np.float32)
        grey, mask = np.ascontiguousarray(grey), np.ascontiguousarray(cells).view(np.uint8)
        if mask.shape != (wanted := tuple(-(-n // CELL) for n in grey.shape)):
            raise RcdnError(f"cells must have shape {wanted} for a picture of shape {grey.shape}, not {mask.shape}")
        count = max(1, min(threads or cores(), height // BAND))
        edges = np.linspace(0, height, count + 1).astype(int).tolist()

        def run(band: tuple[int, int]) -> None:
            _network(grey, self.reals, self.whole, instructions, mask, band[0], band[1] - band[0], out)

        self.pool(run, pairwise(edges), count)
        return out


def units(ranges: Sequence[Sequence[float]]) -> list[Array]:
    """The value of one quantisation step in each channel of each hidden layer. Raises RcdnError if their number is
    wrong."""
    if [len(values) for values in ranges] != [shape[0] for shape in SHAPES[:-1]]:
        raise RcdnError("model: 'ranges' must hold a number for each output of each hidden layer")
    return [np.array(values) / LEVELS for values in ranges]


def _convolutions(graph: Graph) -> list[tuple[str, ...]]:
    """Names of the inputs of each convolution: its input, its weights, its biases."""
    return [graph.inputs[k] for k, name in enumerate(graph.nodes) if name == "Conv"]


def _shapes(graph: Graph) -> tuple[tuple[int, ...], ...]:
    known = graph.tensors  # float32 only
    return tuple(known[n[1]].shape if n[1] in known and n[2] in known else () for n in _convolutions(graph))


def _grouped(weight: Array) -> Array:
    """Weights (outputs, inputs, 3, 3), flattened in the order (height, width, group of inputs, output, input of the
    group)."""
    outputs, inputs = weight.shape[:2]
    apart = weight.transpose(2, 3, 1, 0).reshape(9, inputs // GROUP, GROUP, outputs)
    return np.ascontiguousarray(apart.swapaxes(2, 3)).ravel()
