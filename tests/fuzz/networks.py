"""Weights of callers: an ONNX file and the JSON beside it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from tests.fuzz import samples
from tests.fuzz.mutate import changed_bytes, changed_tree
from tests.fuzz.source import Source
from tests.fuzz.target import Target, as_file, must

from rcdn import Detector, DetectorConfig
from rcdn.corners.onnx_file import read_graph


@dataclass(frozen=True)
class Model:
    """Both files."""

    onnx: bytes
    facts: bytes


def _model(source: Source) -> Model:
    data, facts = samples.model()
    kind = source.byte() % 4
    if kind:
        data = _changed(source, data)
    facts = json.loads(json.dumps(facts))
    facts["sha256"] = hashlib.sha256(data).hexdigest()
    if kind != 1:
        facts = changed_tree(source, facts)
    return Model(data, json.dumps(facts).encode())


def _changed(source: Source, data: bytes) -> bytes:
    """Changes anywhere, or where the graph is described, before and after the weights."""
    if source.chance(3):
        return changed_bytes(source, data)
    cut = source.choice((200, 2000))
    if source.byte() % 2:
        return changed_bytes(source, data[:cut]) + data[cut:]
    return data[:-cut] + changed_bytes(source, data[-cut:])


def _use(model: Model) -> None:
    path = as_file(model.onnx, ".onnx", "model")
    as_file(model.facts, ".json", "model")
    found = Detector(DetectorConfig(model=str(path), threads=1)).response(samples.picture())
    must(
        found.dtype == np.float32 and found.shape == samples.picture().shape, f"a response {found.dtype} {found.shape}"
    )


def _graph(data: Any) -> None:
    for tensor in read_graph(data).tensors.values():
        must(tensor.dtype == np.float32, f"a tensor of {tensor.dtype}")


TARGETS = [
    Target("models", _model, _use, share=2, tries=20),
    Target("graphs", lambda source: changed_bytes(source, samples.model()[0]), _graph, ".onnx", share=0.5, guided=True),
]
