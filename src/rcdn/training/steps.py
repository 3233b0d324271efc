"""A training run between its first and its last step: updates of the weights, the log, checkpoints."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch.utils.tensorboard import SummaryWriter

from rcdn.errors import OutputError, RcdnError
from rcdn.io import write_text
from rcdn.provenance import commit
from rcdn.training.config import TrainConfig
from rcdn.training.loss import loss_function, response
from rcdn.training.machine import machine
from rcdn.training.mining import false_answers
from rcdn.training.net import ARCHITECTURES
from rcdn.training.on_device import DevicePool, Recorded
from rcdn.training.samples import Pool, Windows, windows
from rcdn.training.validate import validate

DEAD_AFTER, DEAD_RESPONSE = 500, 1e-3
LOOK = 100
"""steps on a graphics card between two looks at its numbers, for which the processor must wait"""


class DeadNetError(RcdnError):
    """The network no longer responds at any corner: train it again with another seed or `loss = "safe"`."""


def windows_of(config: TrainConfig, pool: Pool, rank: int, often: torch.Tensor, step: int) -> Windows:
    """What is random about the batch of a step; `often` as in `samples.windows`, empty: all crops alike."""
    room = pool.images.shape[1] - config.side
    probability = often.numpy() if len(often) else None
    return windows(len(pool), room, config.batch, config.normalisation, (config.seed, rank, step), probability)


class Run:
    """State of a run between steps: averages for the log, the progress bar, checkpoints."""

    def __init__(
        self,
        config: TrainConfig,
        folder: Path,
        fabric: Fabric,
        state: dict[str, Any],
        pool: Pool,
        overfit: bool,
        kept: list[torch.nn.Parameter],
    ) -> None:
        self.kept, self.pool = kept, pool
        self.config, self.folder, self.fabric, self.state = config, folder, fabric, state
        self.overfit = pool if overfit else None
        self.loss = loss_function(config.loss, config.background)
        self.loss_sum, self.positive_sum, self.count, self.silent = (torch.zeros((), device=fabric.device),) * 4
        self.clock = time.perf_counter()
        self.facts: dict[str, Any] = {"commit": commit(), "machine": machine()}  # of the code that runs now, not later
        self.events: Any = SummaryWriter(str(folder / "events")) if fabric.is_global_zero else None
        self.margins = ARCHITECTURES[config.architecture].margins
        self.on_device: DevicePool | None = None
        self.recorded: Recorded | None = None
        self.averaged: list[list[tuple[torch.Tensor, torch.Tensor]]] | None = None
        if fabric.device.type == "cuda" and fabric.world_size == 1:
            torch.backends.cudnn.benchmark = True  # windows are all of one size
            heat = config.loss == "heatmap"
            self.on_device = DevicePool(pool, config.normalisation, config.ring, heat, fabric.device)

    def numbers(self, there: DevicePool) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """What a graphics card needs for a batch, step by step."""
        for step in range(self.state["step"], self.config.steps):
            yield there.numbers(windows_of(self.config, self.pool, 0, self.state["often"], step))

    def go(self, loader: Any) -> None:
        """Train to the end."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        quiet = not (self.fabric.is_global_zero and sys.stderr.isatty())
        with Progress(*columns, console=Console(stderr=True), disable=quiet) as bar:
            task = bar.add_task(self.config.name, total=self.config.steps, completed=self.state["step"])
            for batch in loader:
                self.step(*batch)
                step = self.state["step"]
                if not quiet and step % 10 == 0:
                    text = f"{self.config.name} loss {float(self.loss_sum / self.count):.4f}"
                    bar.update(task, completed=step, description=text)
                if self.config.mined and step % self.config.mined == 0 and step < self.config.steps:
                    self.state["often"] = false_answers(self.state["ema"], self.config, self.pool, self.on_device)
                if step % self.config.validate_every == 0 or step == self.config.steps:
                    self.report()

    def close(self) -> None:
        """Close the TensorBoard file."""
        if self.events is not None:
            self.events.close()

    def step(self, *batch: Any) -> None:
        """One update of the weights and of their moving average."""
        model, optimiser = self.state["model"], self.state["optimiser"]
        model.train()
        if self.on_device is None:
            optimiser.zero_grad()
            loss, positive = self._gradients(*batch)
        else:
            loss, positive = self._replayed(self.on_device, *batch)
        if self.state["step"] < self.config.frozen:
            for parameter in self.kept:
                parameter.grad = None  # the optimiser skips it
        if self.config.clip:
            self.fabric.clip_gradients(model, optimiser, max_norm=self.config.clip, error_if_nonfinite=False)
        optimiser.step()
        self.state["schedule"].step()
        self.state["step"] += 1
        self._average(model)
        self._watch(loss, positive)

    def _gradients(self, image: torch.Tensor, goal: Any) -> tuple[torch.Tensor, torch.Tensor]:
        """The loss, and the mean response at its corners (NaN if none); gradients are left at the parameters."""
        z = self.state["model"](image.to(memory_format=torch.channels_last))
        loss = self.loss(z, goal)
        self.fabric.backward(loss)
        answers = response(z.detach(), self.config.loss) * goal.positive
        return loss.detach(), answers.sum() / goal.positive.sum()

    def _replayed(self, there: DevicePool, whole: torch.Tensor, real: torch.Tensor) -> Any:
        """As `_gradients`, of the windows that the pool's `numbers` tell, by a CUDA graph."""
        parameters = list(self.state["model"].parameters())
        if self.recorded is None:

            def work(whole: torch.Tensor, real: torch.Tensor) -> Any:
                for parameter in parameters:
                    parameter.grad = None
                return self._gradients(*there.batch(whole, real, self.config.side, self.margins))

            self.recorded = Recorded(work, (whole, real), list(self.state["model"].buffers()))
            self.grads = [parameter.grad for parameter in parameters]
        for parameter, grad in zip(parameters, self.grads, strict=True):
            parameter.grad = grad
        return self.recorded(whole, real)

    @torch.no_grad()
    def _average(self, model: Any) -> None:
        keep = min(self.config.ema, (1 + self.state["step"]) / (10 + self.state["step"]))
        if self.averaged is None:
            pairs = list(zip(self.state["ema"].state_dict().values(), model.state_dict().values(), strict=True))
            self.averaged = [[p for p in pairs if p[0].dtype.is_floating_point is real] for real in (True, False)]
        floating, counts = self.averaged
        torch._foreach_lerp_([kept for kept, _ in floating], [new for _, new in floating], 1 - keep)
        for kept, new in counts:
            kept.copy_(new)

    def _watch(self, loss: torch.Tensor, positive: torch.Tensor) -> None:
        self.loss_sum = self.loss_sum + loss
        self.positive_sum = self.positive_sum + positive.nan_to_num(0.0)
        self.count = self.count + 1
        self.silent = torch.where(positive >= DEAD_RESPONSE, 0, self.silent + (positive < DEAD_RESPONSE))
        look = self.fabric.device.type == "cpu" or self.state["step"] % LOOK == 0
        if look and float(self.silent) >= DEAD_AFTER:
            raise DeadNetError(
                f"{self.config.name}: no response at any corner for {DEAD_AFTER} steps (loss {float(loss):.4f}); "
                'the net is dead: use another seed, or loss = "safe"'
            )

    def report(self) -> None:
        """Validate, log, save."""
        loss, positive = (float(total / self.count) for total in (self.loss_sum, self.positive_sum))  # waits for a card
        self.state["seconds"] += time.perf_counter() - self.clock
        row = {
            "step": self.state["step"],
            "loss": round(loss, 6),
            "positive": round(positive, 4),
            "seconds": round(self.state["seconds"], 1),
        }
        if self.fabric.is_global_zero:
            row |= validate(self.state["ema"], self.config, self.overfit)
            self._log(row)  # before the checkpoint: a run killed in between will log this step again
        self._save(self.folder / "new.pt")
        if self.fabric.is_global_zero:
            (self.folder / "new.pt").replace(self.folder / "last.pt")
        self.fabric.barrier()
        self.loss_sum, self.positive_sum, self.count = (torch.zeros((), device=self.fabric.device),) * 3
        self.clock = time.perf_counter()

    def _save(self, path: Path) -> None:
        try:
            self.fabric.save(path, self.state)
        except (OSError, RuntimeError) as error:  # torch reports a full disk by various errors
            path.unlink(missing_ok=True)
            reason = str(error).strip().splitlines()[0]
            raise OutputError(
                f"{path}: can't be written: {reason}; make room, then run the same command again: "
                "it goes on from its last checkpoint"
            ) from error

    def _log(self, row: dict[str, Any]) -> None:
        path, line = self.folder / "metrics.csv", io.StringIO()
        writer = csv.DictWriter(line, row, lineterminator="\n")
        if not path.exists():
            writer.writeheader()
        writer.writerow(row)
        write_text(
            path, (path.read_text() if path.exists() else "") + line.getvalue()
        )  # atomically: a partly written row would be read as a row
        for key, value in row.items():
            self.events.add_scalar(key, value, row["step"])
        self.events.flush()
        metrics = {key: value if math.isfinite(value) else None for key, value in row.items()}  # JSON has no NaN
        facts = {"config": dataclasses.asdict(self.config), "metrics": metrics} | self.facts
        write_text(self.folder / "run.json", json.dumps(facts, indent=1) + "\n")
        print(", ".join(f"{k} {v}" for k, v in row.items()), flush=True)
