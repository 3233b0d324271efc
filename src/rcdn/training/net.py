"""All network architectures as data: Table 1 of the paper, its two variants, and the fast cell network of `auto`."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from rcdn.corners.onnx_file import read_graph
from rcdn.errors import ConfigError, RcdnError


@dataclass(frozen=True)
class Architecture:
    """A sequence of convolutions (kernel, channels, stride) with ReLU between them.

    `cell`: side of the pixel block of one output position (1: a pixel; 4: 16 channels become 4×4 pixels).
    `batch_norm`: batch normalisation after each convolution except the last; folded into it on export. `last_bias`:
    initial bias of the last layer.
    """

    layers: tuple[tuple[int, int, int], ...]
    cell: int = 1
    batch_norm: bool = False
    last_bias: float = 0.1

    @property
    def margins(self) -> tuple[int, int]:
        """Pixels of context before and after the output's own pixels, per axis."""
        reach, step = 1, 1
        for kernel, _, stride in self.layers:
            reach += (kernel - 1) * step
            step *= stride
        total = reach - self.cell
        return total // 2, total - total // 2

    @property
    def macs(self) -> float:
        """Multiply–adds per pixel."""
        total, channels, step = 0.0, 1, 1
        for kernel, out, stride in self.layers:
            step *= stride
            total += kernel * kernel * channels * out / step**2
            channels = out
        return total


def _table(text: str) -> Architecture:
    """`13-16, 1-8` → kernel 13, 16 channels; kernel 1, 8 channels."""
    pairs = [part.split("-") for part in text.split(", ")]
    return Architecture(tuple((int(k), int(c), 1) for k, c in pairs))


ARCHITECTURES = {
    "A": _table("13-16, 1-8, 3-1"),
    "B": _table("13-16, 1-8, 3-16, 1-1"),
    "C": _table("7-16, 7-16, 1-8, 3-16, 1-1"),
    "D": _table("13-16, 3-32, 3-32, 1-1"),
    "D-3": _table("13-16, 3-32, 3-32, 3-1"),
    "E": _table("13-32, 3-32, 3-32, 3-32, 1-1"),
    "E-16": _table("13-16, 3-32, 3-32, 3-32, 1-1"),
    "F": _table("13-32, 3-32, 3-32, 3-32, 1-32, 1-1"),
    "G": _table("13-32, 5-32, 3-32, 3-32, 1-32, 1-1"),
    "H": _table("13-32, 3-32, 3-32, 3-32, 3-32, 1-32, 1-1"),
    # the last bias of Q encodes that corners are rare, since its response is a sigmoid
    "Q": Architecture(
        ((5, 16, 2), (3, 32, 2), *([(3, 32, 1)] * 5), (1, 16, 1)), cell=4, batch_norm=True, last_bias=-5.0
    ),
}
"""Name → architecture. A–H, D-3 and E-16 are the paper's (Table 1, section 4.1); Q is ours."""


class CornerNet(nn.Module):
    """(B, 1, H, W) normalised grey → (B, h, w) pre-activation of the response, h = H − sum(margins).

    Convolutions are not padded: the caller pads the picture (by reflection) with `architecture.margins`, so that a tile
    and the whole picture give the same results. The paper's zero padding differs at the border only.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        channels, blocks = 1, []
        for index, (kernel, out, stride) in enumerate(architecture.layers):
            last = index == len(architecture.layers) - 1
            block: list[nn.Module] = [nn.Conv2d(channels, out, kernel, stride)]
            if not last:
                block += [nn.BatchNorm2d(out), nn.ReLU()] if architecture.batch_norm else [nn.ReLU()]
            blocks.append(nn.Sequential(*block))
            channels = out
        self.blocks = nn.Sequential(*blocks)
        self.reset()

    def reset(self) -> None:
        """Xavier weights and biases of 0.1 (paper section 3.2); zero biases where a batch norm follows."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_uniform_(module.weight)
                nn.init.constant_(module.bias, 0.0 if self.architecture.batch_norm else 0.1)
        nn.init.constant_(self.blocks[-1][0].bias, self.architecture.last_bias)

    def forward(self, image: Tensor) -> Tensor:
        out = self.blocks(image)
        if self.architecture.cell > 1:
            out = nn.functional.pixel_shuffle(out, self.architecture.cell)
        return out[:, 0]


def build(name: str, batch_norm: bool = False, start: str = "") -> CornerNet:
    """The network called `name`, with initial weights; `batch_norm` adds batch normalisation if it has none.

    `start`: the file of weights that it will begin with; an exported network (.onnx) has no batch normalisation any
    more, so that this one gets none.
    """
    if name not in ARCHITECTURES:
        raise ConfigError(f"architecture must be one of {sorted(ARCHITECTURES)}, not {name!r}")
    arch = ARCHITECTURES[name]
    return CornerNet(replace(arch, batch_norm=(arch.batch_norm or batch_norm) and not exported(start)))


def exported(start: str | Path) -> bool:
    """Whether a file of weights is an exported network, by its name."""
    return Path(start).suffix == ".onnx"


def grow(student: CornerNet, teacher: CornerNet, noise: float = 0.01) -> list[nn.Parameter]:
    """Copy the layers of `teacher` into `student` and initialise its second-to-last layer by copies of the teacher's
    last one; returns the student's parameters taken from the teacher.

    Paper section 3.1: an extra 1×1 layer that fuses pretrained networks (A → B, E → F). The paper doesn't state how;
    here each channel of the second-to-last layer is the teacher's output with noise of `noise` on its weights, and the
    last layer computes their mean, so that the student initially equals the teacher. `teacher` must have no batch
    normalisation (see `without_norms`). Raises ConfigError if the student isn't the teacher with one more layer.
    """
    *shared, last = teacher.architecture.layers
    kernel, _, stride = last
    new = student.architecture.layers[len(shared) :]
    if (
        student.architecture.layers[: len(shared)] != tuple(shared)
        or len(new) != 2
        or (new[0][0], new[0][2]) != (kernel, stride)
    ):
        raise ConfigError("config: the teacher's layers must be the network's, but for one more at its end")
    kept: list[nn.Parameter] = []
    with torch.no_grad():
        for mine, theirs in zip(student.blocks, teacher.blocks[:-1], strict=False):
            mine[0].weight.copy_(theirs[0].weight)
            mine[0].bias.copy_(theirs[0].bias)
            kept += [mine[0].weight, mine[0].bias]
        copies, mean, answer = student.blocks[-2][0], student.blocks[-1][0], teacher.blocks[-1][0]
        copies.weight.copy_(answer.weight + noise * torch.randn_like(copies.weight))
        copies.bias.copy_(answer.bias.expand_as(copies.bias))
        mean.weight.fill_(1 / copies.out_channels)
        mean.bias.zero_()
    return kept


def folded(block: Any) -> tuple[Tensor, Tensor]:
    """Weight and bias of a convolution, with any batch normalisation that follows folded into them."""
    conv = block[0]
    weight, bias = conv.weight.detach().double(), conv.bias.detach().double()
    if len(block) > 1 and isinstance(block[1], nn.BatchNorm2d):
        norm = block[1]
        scale = norm.weight.detach().double() / torch.sqrt(norm.running_var.double() + norm.eps)
        weight = weight * scale[:, None, None, None]
        bias = (bias - norm.running_mean.double()) * scale + norm.bias.detach().double()
    return weight.float(), bias.float()


def without_norms(net: CornerNet) -> CornerNet:
    """The same network for evaluation, its batch normalisation folded into the preceding convolutions."""
    plain = CornerNet(replace(net.architecture, batch_norm=False))
    with torch.no_grad():
        for mine, theirs in zip(plain.blocks, net.blocks, strict=True):
            for own, value in zip((mine[0].weight, mine[0].bias), folded(theirs), strict=True):
                own.copy_(value)
    return plain


def load_average(net: CornerNet, path: Path) -> None:
    """Load the averaged weights of a checkpoint (last.pt), or those of an exported network (.onnx), into `net`. Raises
    RcdnError if there are none that fit."""
    try:
        net.load_state_dict(
            _of_onnx(path) if exported(path) else torch.load(path, map_location="cpu", weights_only=True)["ema"]
        )
    except (OSError, EOFError, KeyError, TypeError, RuntimeError, RcdnError, pickle.UnpicklingError) as error:
        raise RcdnError(f"{path} holds no weights of `rcdn train` that fit this network: {error}") from error


def _of_onnx(path: Path) -> dict[str, Tensor]:
    """The state of a network without batch normalisation from a file that `rcdn export` wrote."""
    parts = {"w": "weight", "b": "bias"}
    tensors = read_graph(path.read_bytes()).tensors
    return {f"blocks.{n[1:]}.0.{parts[n[0]]}": torch.from_numpy(t.copy()) for n, t in tensors.items() if n[0] in parts}


def parameter_count(net: nn.Module) -> int:
    """Number of parameters of the exported network: weights and biases of its convolutions, with batch normalisation
    folded in."""
    return sum(p.numel() for m in net.modules() if isinstance(m, nn.Conv2d) for p in m.parameters())


def load_run(folder: Path) -> tuple[CornerNet, dict[str, Any]]:
    """The network of a training run with its averaged weights, in evaluation mode, and the content of `run.json`."""
    report = read_report(folder)
    config = report["config"]
    net = build(config["architecture"], config.get("batch_norm") is True, str(config.get("start", "")))
    load_average(net, folder / "last.pt")
    return net.eval(), report


def read_report(folder: Path) -> dict[str, Any]:
    """The content of a run's `run.json`. Raises RcdnError if it wasn't written by `rcdn train`."""
    try:
        report = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        config, metrics = report["config"], report["metrics"]
        texts = [config["architecture"], config["loss"], config["normalisation"], config["pool"]["ranges"]]
        counts = [config["steps"], config["validate_every"], metrics["step"]]
    except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise RcdnError(f"{folder} is not the folder of a run of `rcdn train`: {error}") from error
    if not all(isinstance(v, str) for v in texts) or not all(type(v) is int for v in counts):
        raise RcdnError(f"{folder} is not the folder of a run of `rcdn train`: run.json has another form")
    return dict(report)
