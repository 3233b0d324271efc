"""The training loop: one file, top to bottom. The same code on a CPU, a GPU, or many nodes (Lightning Fabric)."""

from __future__ import annotations

import copy
import csv
import dataclasses
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric
from lightning_fabric.utilities import rank_zero_only
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rcdn.errors import RcdnError
from rcdn.training.config import TrainConfig
from rcdn.training.loss import LOSSES
from rcdn.training.net import CornerNet, build
from rcdn.training.samples import Batches, Pool, batch, make_pool
from rcdn.training.validate import validate

DEAD_AFTER, DEAD_RESPONSE = 500, 1e-3


class DeadNetError(RcdnError):
    """The network answers nothing at corners any more and never will: start again with another seed or `loss = "safe"`."""


def train(config: TrainConfig, runs: Path, *, overfit: int = 0, workers: int = 1, resume: bool = True, fabric: Fabric | None = None) -> Path:
    """Train a network; returns the run's folder `runs`/`name` with `last.pt`, `metrics.csv`, `run.json` and TensorBoard events.

    A run that was killed goes on from its last checkpoint with the batches it would have seen. `overfit`: train and validate on that many
    crops only (sanity check: F1 must go to 1). Raises DeadNetError if the positives' mean response stays under 1e-3.
    """
    fabric = fabric or Fabric(accelerator="auto", devices="auto")
    if fabric.world_size == 1:
        fabric.launch()
    folder = runs / (config.name + ("-overfit" if overfit else ""))
    folder.mkdir(parents=True, exist_ok=True)
    pool = _pool(config, runs, fabric, overfit)
    fabric.seed_everything(config.seed + fabric.global_rank, verbose=False)
    net = build(config.architecture).to(memory_format=torch.channels_last)
    if config.start:
        net.load_state_dict(torch.load(config.start, map_location="cpu", weights_only=False)["ema"])
    optimiser, schedule = _optimiser(net, config)
    average = copy.deepcopy(net).requires_grad_(False).eval()
    model, optimiser = fabric.setup(net, optimiser)
    average = average.to(fabric.device)
    state: dict[str, Any] = {"model": model, "optimiser": optimiser, "schedule": schedule, "ema": average, "step": 0, "seconds": 0.0}
    if resume and (folder / "last.pt").exists():
        fabric.load(folder / "last.pt", state)
    loader = fabric.setup_dataloaders(_loader(config, pool, state["step"], workers, fabric))
    _Run(config, folder, fabric, state, pool if overfit else None).go(loader)
    return folder


def _pool(config: TrainConfig, runs: Path, fabric: Fabric, overfit: int) -> Pool:
    """One process renders, the others wait and then read."""
    with fabric.rank_zero_first():
        pool = make_pool(config.pool, runs, progress=lambda done, total: fabric.print(f"rendering pool: {done}/{total}", flush=True))
    return Pool(pool.images[:overfit], pool.labels[:overfit]) if overfit else pool


def _optimiser(net: CornerNet, config: TrainConfig) -> tuple[torch.optim.Optimizer, torch.optim.lr_scheduler.LRScheduler]:
    if config.optimiser == "sgd":
        sgd = torch.optim.SGD(net.parameters(), config.rate, momentum=0.9, weight_decay=config.decay)
        return sgd, torch.optim.lr_scheduler.ExponentialLR(sgd, 0.01 ** (1 / config.steps))
    adam = torch.optim.AdamW(net.parameters(), config.rate, weight_decay=config.decay)
    return adam, torch.optim.lr_scheduler.OneCycleLR(adam, config.rate, config.steps, pct_start=0.1)


def _loader(config: TrainConfig, pool: Pool, start: int, workers: int, fabric: Fabric) -> Any:
    arch = build(config.architecture).architecture
    make = partial(_numbered, pool, arch, config, fabric.global_rank)
    return torch.utils.data.DataLoader(Batches(make, start, config.steps), batch_size=None, num_workers=workers)


def _numbered(pool: Pool, arch: Any, config: TrainConfig, rank: int, step: int) -> Any:
    return batch(pool, arch, config.side, config.batch, config.normalisation, config.ring, (config.seed, rank, step))


class _Run:
    """State of a run between steps: averages for the log, the progress bar, checkpoints."""

    def __init__(self, config: TrainConfig, folder: Path, fabric: Fabric, state: dict[str, Any], overfit: Pool | None) -> None:
        self.config, self.folder, self.fabric, self.state, self.overfit = config, folder, fabric, state, overfit
        self.loss_sum, self.positive_sum, self.count, self.silent = 0.0, 0.0, 0, 0
        self.clock = time.perf_counter()
        self.writer: Any = None

    def go(self, loader: Any) -> None:
        """Train to the end."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, disable=not self.fabric.is_global_zero) as bar:
            task = bar.add_task(self.config.name, total=self.config.steps, completed=self.state["step"])
            for image, goal in loader:
                self.step(image, goal)
                bar.update(task, completed=self.state["step"], description=f"{self.config.name} loss {self.loss_sum / max(self.count, 1):.4f}")
                if self.state["step"] % self.config.validate_every == 0 or self.state["step"] == self.config.steps:
                    self.report()

    def step(self, image: torch.Tensor, goal: Any) -> None:
        """One update of the weights and of their moving average."""
        model, optimiser = self.state["model"], self.state["optimiser"]
        model.train()
        z = model(image.to(memory_format=torch.channels_last))
        loss = LOSSES[self.config.loss](z, goal)
        optimiser.zero_grad()
        self.fabric.backward(loss)
        if self.config.clip:
            self.fabric.clip_gradients(model, optimiser, max_norm=self.config.clip, error_if_nonfinite=False)
        optimiser.step()
        self.state["schedule"].step()
        self.state["step"] += 1
        self._average(model)
        self._watch(float(loss.detach()), z.detach(), goal)

    @torch.no_grad()
    def _average(self, model: Any) -> None:
        keep = min(self.config.ema, (1 + self.state["step"]) / (10 + self.state["step"]))
        for kept, new in zip(self.state["ema"].state_dict().values(), model.state_dict().values(), strict=True):
            if kept.dtype.is_floating_point:
                kept.lerp_(new, 1 - keep)
            else:
                kept.copy_(new)

    def _watch(self, loss: float, z: torch.Tensor, goal: Any) -> None:
        response = torch.relu(z) if self.config.loss != "heatmap" else torch.sigmoid(z)
        positive = float(response[goal.positive].mean()) if bool(goal.positive.any()) else 0.0
        self.loss_sum, self.positive_sum, self.count = self.loss_sum + loss, self.positive_sum + positive, self.count + 1
        self.silent = self.silent + 1 if positive < DEAD_RESPONSE else 0
        if self.silent >= DEAD_AFTER:
            raise DeadNetError(f"{self.config.name}: no response at any corner for {DEAD_AFTER} steps (loss {loss:.4f}); "
                               'the net is dead: use another seed, or loss = "safe"')  # fmt: skip

    def report(self) -> None:
        """Validate, log, save."""
        self.state["seconds"] += time.perf_counter() - self.clock
        row = {"step": self.state["step"], "loss": round(self.loss_sum / max(self.count, 1), 6),
               "positive": round(self.positive_sum / max(self.count, 1), 4), "seconds": round(self.state["seconds"], 1)}  # fmt: skip
        if self.fabric.is_global_zero:
            row |= validate(self.state["ema"], self.config, self.overfit)
            self._log(row)
        self.fabric.save(self.folder / "new.pt", self.state)
        if self.fabric.is_global_zero:
            (self.folder / "new.pt").replace(self.folder / "last.pt")
        self.fabric.barrier()
        self.loss_sum, self.positive_sum, self.count, self.clock = 0.0, 0.0, 0, time.perf_counter()

    @rank_zero_only
    def _log(self, row: dict[str, Any]) -> None:
        path = self.folder / "metrics.csv"
        new = not path.exists()
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, row)
            if new:
                writer.writeheader()
            writer.writerow(row)
        if self.writer is None:
            from torch.utils.tensorboard import SummaryWriter

            self.writer = SummaryWriter(str(self.folder / "events"))
        for key, value in row.items():
            self.writer.add_scalar(key, value, row["step"])
        self.writer.flush()
        settings = dataclasses.asdict(self.config)
        (self.folder / "run.json").write_text(json.dumps({"config": settings, "metrics": row}, indent=1))
        print(", ".join(f"{k} {v}" for k, v in row.items()), flush=True)
