"""Export of trained weights to ONNX, with a file of their provenance.

The graph is built node by node, so that this file documents its content.
"""

from __future__ import annotations

import csv
import dataclasses
import datetime
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor
from torch.nn.functional import conv2d, relu

from rcdn.corners.cells import CellNetwork
from rcdn.corners.normalise import normalise
from rcdn.corners.onnx_file import read_graph
from rcdn.corners.response import ResponseModel
from rcdn.errors import ConfigError, RcdnError
from rcdn.io import write_bytes, write_text
from rcdn.provenance import commit
from rcdn.synthetic import HARD, PRESETS, random_crop, random_scene, render
from rcdn.training.config import TrainConfig
from rcdn.training.loss import ACTIVATION
from rcdn.training.machine import machine
from rcdn.training.net import ARCHITECTURES, Architecture, CornerNet, folded, load_run, parameter_count
from rcdn.training.quantise import quantised, sidecar_text
from rcdn.training.samples import PoolConfig
from rcdn.training.validate import torch_response, validate
from rcdn.types import Array

OPSET = 17
PARITY = 1e-4
"""largest difference between torch and ONNX Runtime at which weights are exported"""
PICTURES, SIDE, FIRST = 400, 240, 8_000_000
"""rendered pictures whose values tell the ranges of hidden layers: number, side in px, and the first seed"""
LEAST_RANGE = 1e-3
"""range of a channel that is never active"""

Layer = tuple[Tensor, Tensor, int]
"""weights (outputs, inputs, k, k), biases (outputs,), stride"""


def to_onnx(net: CornerNet, activation: str) -> onnx.ModelProto:
    """ONNX graph: `image` (N, 1, H, W) normalised and padded → `response` (N, 1, h, w), final activation included."""
    nodes, constants, last = [], [], "image"
    arch = net.architecture
    for index, (block, (_, _, stride)) in enumerate(zip(net.blocks, arch.layers, strict=True)):
        for name, value in zip((f"w{index}", f"b{index}"), folded(block), strict=True):
            constants.append(numpy_helper.from_array(value.cpu().numpy(), name))
        inputs = [last, f"w{index}", f"b{index}"]
        nodes.append(helper.make_node("Conv", inputs, [f"c{index}"], strides=[stride, stride]))
        last = f"c{index}"
        if index < len(arch.layers) - 1:
            nodes.append(helper.make_node("Relu", [last], [f"r{index}"]))
            last = f"r{index}"
    final = {"relu": "Relu", "sigmoid": "Sigmoid"}[activation]
    nodes.append(helper.make_node(final, [last], ["a"]))
    if arch.cell > 1:  # mode CRD is torch's pixel_shuffle
        nodes.append(helper.make_node("DepthToSpace", ["a"], ["response"], blocksize=arch.cell, mode="CRD"))
    else:
        nodes.append(helper.make_node("Identity", ["a"], ["response"]))
    graph = helper.make_graph(
        nodes, "rcdn",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 1, "H", "W"])],
        [helper.make_tensor_value_info("response", TensorProto.FLOAT, ["N", 1, "h", "w"])],
        constants,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="rcdn")
    model.ir_version = 8
    onnx.checker.check_model(model)
    return model


def provenance(report: dict[str, Any], net: CornerNet, data: bytes) -> dict[str, Any]:
    """Content of the .json beside the weights: architecture, recipe, commit, seed, metrics, sha256, and the parameters
    needed for inference."""
    config = report["config"]
    arch: Architecture = ARCHITECTURES[config["architecture"]]
    return {
        "architecture": config["architecture"],
        "layers": [f"{k}-{c}" + (f"/{s}" if s > 1 else "") for k, c, s in arch.layers],
        "parameters": parameter_count(net),
        "mac_per_pixel": round(arch.macs),
        "normalisation": config["normalisation"],
        "margins": list(arch.margins),
        "cell": arch.cell,
        "sha256": hashlib.sha256(data).hexdigest(),
        "training": config,
        "metrics": report["metrics"],
        "commit": report.get("commit") or commit(),
        "date": datetime.date.today().isoformat(),
        "machine": report.get("machine") or machine(),
    } | ({"labelled": report["labelled"]} if "labelled" in report else {})


def curve(run: Path) -> dict[str, Any]:
    """`curve`: step, loss since the one before, and F1 on the validation set, of each validation of a run; nothing
    without a log."""
    log = run / "metrics.csv"
    if not log.exists():
        return {}
    with log.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {"curve": [[int(r["step"]), float(r["loss"]), float(r["f1"])] for r in rows]}


def ranges(layers: Sequence[Layer], normalisation: str, preset: str) -> list[list[float]]:
    """Largest value of each channel after each hidden layer (convolution and ReLU), over crops rendered with the ranges
    called `preset`; quantised inference needs them."""
    top = [torch.full((len(bias),), LEAST_RANGE) for _, bias, _ in layers[:-1]]
    with torch.no_grad():
        for seed in range(FIRST, FIRST + PICTURES):
            image = random_crop(seed, SIDE, PRESETS[preset])[0]
            values = torch.from_numpy(np.ascontiguousarray(normalise(image, normalisation)))[None, None]
            for k, (weight, bias, stride) in enumerate(layers[:-1]):
                values = relu(conv2d(values, weight, bias, stride=stride))
                top[k] = torch.maximum(top[k], values.amax(dim=(0, 2, 3)))
    return [[round(float(v), 4) for v in values] for values in top]


def parity(net: CornerNet, data: bytes, facts: dict[str, Any], image: Array | None = None) -> float:
    """Largest difference between the responses of torch and of the ONNX file `data`, which is run as in inference.

    `net` in evaluation mode; `facts`: its provenance; `image` (H, W) grey; None = a rendered one of 317 × 203 px.
    """
    if image is None:
        image = render(random_scene(np.random.default_rng(7), HARD, (317, 203)), samples=2)
    config, model = facts["training"], response_model(net, data, facts)
    expected = torch_response(net, image, config["loss"], config["normalisation"])
    return float(np.abs(model.by_onnx_runtime(image, tile=128) - expected).max())


def response_model(net: CornerNet, data: bytes, facts: dict[str, Any]) -> ResponseModel:
    """The model that runs the ONNX file `data` in ONNX Runtime."""
    arch = net.architecture
    return ResponseModel(data, facts["training"]["normalisation"], arch.margins, arch.cell, facts)


SAME = ("architecture", "normalisation", "loss", "start", "teacher")
"""settings in which runs must agree whose weights are averaged"""


def mean_run(runs: Sequence[Path]) -> tuple[CornerNet, dict[str, Any]]:
    """The network whose weights are the mean of those of `runs`, which differ in their seeds or losses but grew from
    one network (Wortsman et al. 2022, "Model soups"); and the content of the first run's `run.json`, with the metrics
    of the mean, and for each run its `seed`, `background`, `metrics`, `commit` and `curve` in `runs`.

    Raises ConfigError if the networks are of different kinds or beginnings, or have batch normalisation, whose
    statistics don't average.
    """
    if len({run.resolve() for run in runs}) < len(runs):
        raise ConfigError("export: a run is named twice; the mean needs different ones")
    nets, reports = zip(*map(load_run, runs), strict=True)
    configs = [r["config"] for r in reports]
    settings = [{key: c.get(key, "") for key in SAME} | {"pool.ranges": c["pool"]["ranges"]} for c in configs]
    for key in settings[0]:
        if len(found := {str(s[key]) for s in settings}) > 1:
            raise ConfigError(f"export: the mean needs runs with one {key}, not {', '.join(sorted(found))}")
    if any(isinstance(m, torch.nn.BatchNorm2d) for net in nets for m in net.modules()):
        raise ConfigError("export: the mean needs networks without batch normalisation; export each run alone")
    config = configs[0]
    if not (config.get("start") or config.get("teacher")):
        raise ConfigError("export: the mean needs runs that grew from one network, by `teacher` or `start`")
    net = nets[0]
    with torch.no_grad():
        for each in zip(*(n.parameters() for n in nets), strict=True):
            each[0].copy_(torch.stack(each).double().mean(dim=0))
    step = {"step": reports[0]["metrics"]["step"]}
    known = {f.name for f in dataclasses.fields(TrainConfig)} & set(config)
    settled = TrainConfig(**{key: config[key] for key in known} | {"pool": PoolConfig(ranges=config["pool"]["ranges"])})
    metrics = step | validate(net, settled)
    about = [
        {"seed": r["config"]["seed"], "background": r["config"].get("background", 1.0), "metrics": r["metrics"]}
        | {"commit": r.get("commit")}
        | curve(run)
        for r, run in zip(reports, runs, strict=True)
    ]
    return net, reports[0] | {"metrics": metrics, "runs": about}


def export(runs: Path | Sequence[Path], target: Path) -> tuple[dict[str, Any], float]:
    """Write `target` (.onnx), its .json, and, for a network that the compiled kernel supports, its 8-bit weights
    (.npz); returns the provenance and the largest difference from torch. Of several runs, the mean of their weights
    (`mean_run`).

    Raises RcdnError, and writes nothing, if a run holds no trained network, if that difference is above 1e-4, or if the
    responses with the 8-bit weights differ too much from the network's (`quantise.BOUNDS`).
    """
    if target.suffix != ".onnx":
        raise ConfigError(f"export: the name of the file must end in .onnx, not {target}")
    several = [runs] if isinstance(runs, Path) else list(runs)
    net, report = load_run(several[0]) if len(several) == 1 else mean_run(several)
    data = to_onnx(net, ACTIVATION[report["config"]["loss"]]).SerializeToString()
    facts = provenance(report, net, data) | (curve(several[0]) if len(several) == 1 else {"runs": report["runs"]})
    if CellNetwork.fits(read_graph(data)) and not facts["training"]["pool"]["ranges"].startswith("deltille"):
        # with 8-bit weights the deltille network has one additional false positive in 100 pictures of clutter
        layers = [(*folded(b), s) for b, (_, _, s) in zip(net.blocks, net.architecture.layers, strict=True)]
        facts["ranges"] = ranges(layers, facts["normalisation"], facts["training"]["pool"]["ranges"])
    gap = parity(net, data, facts)
    if not gap <= PARITY:
        raise RcdnError(
            f"export: ONNX Runtime and torch differ by {gap:.1e}, more than {PARITY:.0e}; nothing was written. "
            "Check the versions of torch, onnx and onnxruntime"
        )
    if found := quantised(response_model(net, data, facts)):
        content, facts["quantised"] = found
        write_bytes(target.with_suffix(".npz"), content)
    write_bytes(target, data)
    write_text(target.with_suffix(".json"), sidecar_text(facts))
    return facts, gap
