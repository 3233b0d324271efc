"""Quantisation of a cell network to 8 bits, validated against its floating-point form before export. Needs no torch."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.corners.cells import CellNetwork
from rcdn.corners.onnx_file import read_graph
from rcdn.corners.quantised import read_npz, to_npz
from rcdn.corners.response import ResponseModel, load_model
from rcdn.errors import RcdnError
from rcdn.io import write_bytes, write_text
from rcdn.validation import score_crop, summary, validation_set

PICTURES = 100
"""number of pictures of the validation set"""
PLAIN = 0.3
"""the mean difference is over pixels with responses above this"""
BOUNDS = {"mean difference": 0.007, "largest difference": 0.06, "loss of F1": 0.005}
"""largest values at which 8-bit weights are exported; those of the shipped weights are .0047, .033 and .0013"""


def quantised(model: ResponseModel) -> tuple[bytes, dict[str, Any]] | None:
    """The 8-bit weights of a network as the content of a file, and their entry in its .json; None if the kernel doesn't
    support the network, or if its ranges are unknown.

    Raises RcdnError if its responses differ too much from those in floating point, by ONNX Runtime, over pictures of
    the validation set.
    """
    network = CellNetwork.of(read_graph(model.onnx), model.facts.get("ranges"))
    if network is None:
        return None
    content = to_npz(network)
    facts = {"sha256": hashlib.sha256(content).hexdigest()}
    figures = compare(replace(model, quantised=read_npz(content, facts["sha256"], "export")))
    for name, most in BOUNDS.items():
        if not figures[name] <= most:
            raise RcdnError(
                f"export: in 8 bits the network differs from itself in floating point: {name} {figures[name]:.4f}, "
                f"more than {most:g}; nothing was written"
            )
    return content, facts | figures


def compare(model: ResponseModel, pictures: int = PICTURES) -> dict[str, Any]:
    """Differences between the responses of the compiled kernel with 8-bit weights and those in floating point."""
    gaps, largest, scores = [], 0.0, ([], [])  # type: ignore[var-annotated]
    for image, corners in validation_set(pictures):
        whole, known = model(image, 1), model.by_onnx_runtime(image, 1)
        gap = np.abs(whole - known)
        gaps.append(gap[known > PLAIN])
        largest = max(largest, float(gap.max()))
        for score, response in zip(scores, (whole, known), strict=True):
            score.append(score_crop(response, corners))
    ours, theirs = (summary(score)["f1"] for score in scores)
    mean = float(np.concatenate(gaps).mean()) if sum(map(len, gaps)) else float("nan")  # NaN fails the bounds
    return {
        "pictures": pictures,
        "mean difference": round(mean, 5),
        "largest difference": round(largest, 5),
        "F1": round(ours, 4),
        "loss of F1": round(theirs - ours, 4),
    }


def store(path: Path) -> dict[str, Any]:
    """Write the 8-bit weights of an exported network (an .onnx file with its .json) beside it; returns their new entry
    in the .json.

    Raises RcdnError, and writes nothing, if there is no such network, if the kernel doesn't support it, or if the
    responses differ too much.
    """
    sidecar = path.with_suffix(".json")
    if path.suffix != ".onnx" or not sidecar.is_file():
        raise RcdnError(
            f"export: {path} is neither the folder of a run nor an exported .onnx file with its .json beside it"
        )
    model = load_model(str(path), stored=False)
    found = quantised(model)
    if found is None:
        raise RcdnError(
            f"export: {path} is no cell network with 'ranges' in its .json: it runs in ONNX Runtime as it is"
        )
    content, figures = found
    write_bytes(path.with_suffix(".npz"), content)
    facts = json.loads(sidecar.read_text(encoding="utf-8")) | {"quantised": figures}
    write_text(sidecar, sidecar_text(facts))
    return figures


def sidecar_text(facts: dict[str, Any]) -> str:
    """Text of the .json beside a network, with each list of numbers on one line."""
    text = json.dumps(facts, indent=1) + "\n"
    return re.sub(r"\[\s+([-+.\deE,\s]+?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", text)
