"""A minimal reader of ONNX files: the sequence of a network's operations, and their tensors.

ONNX files are protocol buffers (onnx.proto): a message is a sequence of fields, each a field number and a type, then a
value.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array

GRAPH, NODE, INITIALIZER = 7, 1, 5
"""field numbers: the graph of a model; nodes and initializers of a graph"""
INPUT, OPERATION = 1, 4
"""field numbers of a node"""
DIMS, KIND, FLOATS, NAME, RAW = 1, 2, 4, 8, 9
"""field numbers of a tensor"""
FLOAT = 1
"""data type of a float32 tensor"""
BITS = 70
"""bits of the longest varint, in groups of seven"""


@dataclass(frozen=True, eq=False)
class Graph:
    """The operations `nodes` of a network in order, the names of each one's `inputs`, and its constant float32
    `tensors` by name."""

    nodes: tuple[str, ...]
    inputs: tuple[tuple[str, ...], ...]
    tensors: dict[str, Array]


def read_graph(data: bytes) -> Graph:
    """The graph in the bytes of an ONNX file, without tensors of other types than float32. Raises RcdnError if it is no
    ONNX file."""
    try:
        return _graph(_bytes(_first(memoryview(data), GRAPH, "graph")))
    except (IndexError, OverflowError, ValueError) as error:
        raise RcdnError(f"model: this is not an ONNX file: {error}") from error


def _graph(data: memoryview) -> Graph:
    nodes, inputs, tensors = [], [], {}
    for field, value in _fields(data):
        if field == NODE:
            node = _bytes(value)
            nodes.append(_text(_first(node, OPERATION, "operation")))
            inputs.append(tuple(_text(v) for f, v in _fields(node) if f == INPUT))
        elif field == INITIALIZER:
            name, tensor = _tensor(_bytes(value))
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
            name = _text(value)
        elif field in (FLOATS, RAW):
            raw += _bytes(value)
    return name, np.frombuffer(raw, "<f4").reshape(shape) if kind == FLOAT else None


def _first(data: memoryview, field: int, what: str) -> Any:
    """Value of the first field with the number `field`."""
    for number, value in _fields(data):
        if number == field:
            return value
    raise ValueError(f"no {what} in it")


def _bytes(value: Any) -> memoryview:
    if isinstance(value, int):
        raise ValueError("a number where bytes should be")
    return memoryview(value)


def _text(value: Any) -> str:
    return bytes(_bytes(value)).decode()


def _fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Number and value of each field of a message: varints as integers, all other types as bytes."""
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
            raise ValueError(f"a field of type {kind}")
        if at + size > len(data):
            raise ValueError("it ends too early")
        yield key >> 3, data[at : at + size]
        at += size


def _numbers(data: memoryview) -> list[int]:
    out, at = [], 0
    while at < len(data):
        value, at = _number(data, at)
        out.append(value)
    return out


def _number(data: memoryview, at: int) -> tuple[int, int]:
    """The varint at `at` (groups of seven bits, the lowest first), and the position after it."""
    value = shift = 0
    while shift < BITS:
        if at == len(data):
            raise ValueError("it ends too early")
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at
    raise ValueError("a number of more than 64 bits")
