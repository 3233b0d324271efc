"""The little of an ONNX file that a network's weights take: which operations follow each other, and their tensors.

ONNX files are protocol buffers (onnx.proto): a message is a row of fields, each a number and a type, then a value.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.types import Array

GRAPH, NODE, INITIALIZER = 7, 1, 5
"""fields of a model and of a graph"""
INPUT, OPERATION = 1, 4
"""of a node"""
DIMS, KIND, FLOATS, NAME, RAW = 1, 2, 4, 8, 9
"""of a tensor"""
FLOAT = 1
"""kind of a tensor of float32"""


@dataclass(frozen=True, eq=False)
class Graph:
    """The operations `nodes` of a network in their order, the names of the `inputs` of each, and its constant float32 `tensors` by name."""

    nodes: tuple[str, ...]
    inputs: tuple[tuple[str, ...], ...]
    tensors: dict[str, Array]


def read_graph(data: bytes) -> Graph:
    """The graph of an ONNX file's bytes. Tensors of other types than float32 are left out."""
    graph = next(value for field, value in _fields(memoryview(data)) if field == GRAPH)
    nodes, inputs, tensors = [], [], {}
    for field, value in _fields(graph):
        if field == NODE:
            parts = list(_fields(value))
            nodes.append(next(bytes(v).decode() for f, v in parts if f == OPERATION))
            inputs.append(tuple(bytes(v).decode() for f, v in parts if f == INPUT))
        elif field == INITIALIZER:
            name, tensor = _tensor(value)
            if tensor is not None:
                tensors[name] = tensor
    return Graph(tuple(nodes), tuple(inputs), tensors)


def _tensor(data: memoryview) -> tuple[str, Array | None]:
    shape: list[int] = []
    name, kind, raw = "", 0, b""
    for field, value in _fields(data):
        if field == DIMS:
            shape += [value] if isinstance(value, int) else _numbers(value)
        elif field == KIND:
            kind = value
        elif field == NAME:
            name = bytes(value).decode()
        elif field in (FLOATS, RAW):
            raw += bytes(value)
    return name, np.frombuffer(raw, "<f4").reshape(shape) if kind == FLOAT else None


def _fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Number and value of each field of a message: integers as they are, all else as bytes."""
    at = 0
    while at < len(data):
        key, at = _number(data, at)
        kind = key & 7
        if kind == 0:
            value, at = _number(data, at)
            yield key >> 3, value
            continue
        if kind == 2:
            size, at = _number(data, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise ValueError(f"not an ONNX file: field of type {kind}")
        yield key >> 3, data[at : at + size]
        at += size


def _numbers(data: memoryview) -> list[int]:
    out, at = [], 0
    while at < len(data):
        value, at = _number(data, at)
        out.append(value)
    return out


def _number(data: memoryview, at: int) -> tuple[int, int]:
    """A number in groups of seven bits, the lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at
