"""Writes a cell network's 8-bit weights as an ONNX file in floating point, for ONNX Runtime on a GPU.

ONNX files are protocol buffers (onnx.proto); `onnx_file.py` reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import prod

import numpy as np

from rcdn.corners.cells import GROUP, NODES, SHAPES, STRIDES, CellNetwork, units
from rcdn.corners.onnx_file import DIMS, FLOAT, GRAPH, INITIALIZER, INPUT, KIND, NAME, NODE, OPERATION, RAW
from rcdn.corners.sieve import CELL
from rcdn.types import Array

IR_VERSION, OPSET = 8, 17
"""version of the file format, and of its operator set"""
VERSION, OPERATIONS = 1, 8
"""field numbers of a model, besides its graph"""
GRAPH_NAME, GRAPH_INPUT, GRAPH_OUTPUT = 2, 11, 12
"""field numbers of a graph"""
OUTPUT, ATTRIBUTE = 2, 5
"""field numbers of a node"""
ATTRIBUTE_INT, ATTRIBUTE_TEXT, ATTRIBUTE_INTS, ATTRIBUTE_KIND = 3, 4, 8, 20
"""field numbers of an attribute"""


def to_onnx(network: CellNetwork, ranges: Sequence[Sequence[float]]) -> bytes:
    """The ONNX file of a network that takes `image` (N, 1, H, W), normalised and padded, and returns `response`
    (N, 1, h, w).

    `ranges`: as in `CellNetwork.of`.
    """
    parts, last, layer = [], "image", 0
    names = [f"v{k}" for k in range(len(NODES) - 1)] + ["response"]
    for name, operation in zip(names, NODES, strict=True):
        inputs, attributes = [last], b""
        if operation == "Conv":
            inputs, attributes = [last, f"w{layer}", f"b{layer}"], _ints("strides", [STRIDES[layer]] * 2)
            layer += 1
        elif operation == "DepthToSpace":
            attributes = _int("blocksize", CELL) + _string("mode", "CRD")
        parts.append(_field(NODE, _node(operation, inputs, name, attributes)))
        last = name
    for k, (weight, bias) in enumerate(tensors(network, ranges)):
        parts += [_field(INITIALIZER, _tensor(f"w{k}", weight)), _field(INITIALIZER, _tensor(f"b{k}", bias))]
    parts += [
        _field(GRAPH_NAME, b"rcdn"),
        _field(GRAPH_INPUT, _value("image")),
        _field(GRAPH_OUTPUT, _value("response")),
    ]
    return _field(VERSION, IR_VERSION) + _field(OPERATIONS, _field(2, OPSET)) + _field(GRAPH, b"".join(parts))


def tensors(network: CellNetwork, ranges: Sequence[Sequence[float]]) -> list[tuple[Array, Array]]:
    """Weights and biases of each convolution, float32: the inverse of `CellNetwork.of`."""
    reals, whole = network.reals.astype(float), network.whole
    outputs, inputs, height, width = SHAPES[0]
    unit = [*units(ranges), np.ones(SHAPES[-1][0])]
    at = prod(SHAPES[0])
    first = reals[:at].reshape(height, width, inputs, outputs).transpose(3, 2, 0, 1) * unit[0][:, None, None, None]
    found, at, start = [(first, reals[at : at + outputs] * unit[0])], at + outputs, 0
    for shape, (before, after) in zip(SHAPES[1:], pairwise(unit), strict=True):
        outputs, inputs, height, width = shape
        scale, bias = (reals[at + k * outputs : at + (k + 1) * outputs] * after for k in range(2))
        at += 2 * outputs
        if start < len(whole):
            stored = whole[start : start + prod(shape)].reshape(height, width, inputs // GROUP, outputs, GROUP)
            levels = stored.transpose(3, 2, 4, 0, 1).reshape(shape)
            start += prod(shape)
        else:
            levels = reals[at:].reshape(inputs, outputs).T.reshape(shape)
        found.append((levels * scale[:, None, None, None] / before[:, None, None], bias))
    return [(weight.astype(np.float32), bias.astype(np.float32)) for weight, bias in found]


def _node(operation: str, inputs: list[str], output: str, attributes: bytes) -> bytes:
    names = b"".join(_field(INPUT, name.encode()) for name in inputs)
    return names + _field(OUTPUT, output.encode()) + _field(OPERATION, operation.encode()) + attributes


def _int(name: str, value: int) -> bytes:
    return _attribute(name, 2, _field(ATTRIBUTE_INT, value))


def _string(name: str, value: str) -> bytes:
    return _attribute(name, 3, _field(ATTRIBUTE_TEXT, value.encode()))


def _ints(name: str, values: list[int]) -> bytes:
    return _attribute(name, 7, b"".join(_field(ATTRIBUTE_INTS, value) for value in values))


def _attribute(name: str, kind: int, value: bytes) -> bytes:
    return _field(ATTRIBUTE, _field(1, name.encode()) + value + _field(ATTRIBUTE_KIND, kind))


def _tensor(name: str, values: Array) -> bytes:
    dims = b"".join(_field(DIMS, n) for n in values.shape)
    return dims + _field(KIND, FLOAT) + _field(NAME, name.encode()) + _field(RAW, values.astype("<f4").tobytes())


def _value(name: str) -> bytes:
    """An input or output (N, 1, H, W): only the number of its channels is fixed."""
    free = [_field(2, f"{name}_{axis}".encode()) for axis in "nhw"]
    dims = (free[0], _field(1, 1), *free[1:])
    shape = b"".join(_field(1, dim) for dim in dims)
    return _field(1, name.encode()) + _field(2, _field(1, _field(1, FLOAT) + _field(2, shape)))


def _field(number: int, value: int | bytes) -> bytes:
    """A field of a message: an integer, or bytes preceded by their length."""
    if isinstance(value, int):
        return _number(number << 3) + _number(value)
    return _number(number << 3 | 2) + _number(len(value)) + value


def _number(value: int) -> bytes:
    """`value` as a varint: groups of seven bits, the lowest first."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])
