"""The complete training loop. The same code runs on a CPU, a GPU, or many nodes (Lightning Fabric)."""

from __future__ import annotations

import contextlib
import copy
import csv
import dataclasses
import io
import json
import math
import pickle
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch.utils.tensorboard import SummaryWriter

from rcdn.children import end_with_parent
from rcdn.errors import ConfigError, OutputError, RcdnError
from rcdn.io import write_text
from rcdn.provenance import commit
from rcdn.synthetic import PRESETS
from rcdn.training.alone import alone
from rcdn.training.config import TrainConfig
from rcdn.training.labelled import fingerprint, labelled_pool, read_labelled
from rcdn.training.loss import ACTIVATION, LOSSES
from rcdn.training.machine import machine
from rcdn.training.net import ARCHITECTURES, CornerNet, build, grow, load_average, load_run, read_report, without_norms
from rcdn.training.on_device import DevicePool, Recorded
from rcdn.training.samples import Batches, Pool, cut, joined, make_pool, whole, windows
from rcdn.training.validate import validate
from rcdn.types.plane import Pattern

DEAD_AFTER, DEAD_RESPONSE = 500, 1e-3
LOOK = 100
"""steps on a graphics card between two looks at its numbers, for which the processor must wait"""
FALSE = 0.25
"""response from which on background counts as falsely answered"""


class DeadNetError(RcdnError):
    """The network no longer responds at any corner: train it again with another seed or `loss = "safe"`."""


def train(
    config: TrainConfig,
    runs: Path,
    *,
    overfit: int = 0,
    workers: int = 1,
    resume: bool = True,
    fabric: Fabric | None = None,
) -> Path:
    """Train a network; returns the folder `runs`/`name`: `last.pt`, `metrics.csv`, `run.json`, TensorBoard events.

    A killed run resumes from its last checkpoint with the same batches as if it had not been killed; without `resume`
    the folder's old run is removed. `overfit`: train and validate on that many crops only, always from the start, in
    `name`-overfit (sanity check: F1 must approach 1). `workers`: processes that prepare batches, 0 = none.
    Raises ConfigError if the folder holds a run with other settings, or if another process trains there; OutputError if
    a checkpoint can't be written; DeadNetError if the positives' mean response stays below 1e-3; and the errors of
    `read_labelled`, before anything is rendered.
    """
    fabric = fabric or Fabric(accelerator="auto", devices="auto")
    fabric.launch()
    cv2.setNumThreads(1)  # pictures are small, and with threads here OpenCV would hang in a loader's forked worker
    if overfit:
        few = dataclasses.replace(config.pool, count=min(overfit, config.pool.count))
        config, resume = dataclasses.replace(config, name=f"{config.name}-overfit", pool=few), False
    folder = runs / config.name
    pictures = read_labelled(config.labelled, _pattern(config)) if config.labelled else []
    facts = fingerprint(pictures) if pictures else None
    _check_same(config, folder, resume, facts)
    with fabric.rank_zero_first():  # one process renders, the others wait and then read
        pool = make_pool(config.pool, runs, progress=lambda n, total: print(f"rendering pool: {n}/{total}", flush=True))
    if pictures:
        crops = round(config.pool.count * config.labelled_share / (1 - config.labelled_share))
        pool = joined(pool, labelled_pool(pictures, max(crops, 1), config.pool.size, config.pool.seed), facts)
    with alone(folder) if fabric.is_global_zero else contextlib.nullcontext():
        _learn(config, runs, pool, bool(overfit), workers, resume, fabric)
    return folder


def _learn(
    config: TrainConfig, runs: Path, pool: Pool, overfit: bool, workers: int, resume: bool, fabric: Fabric
) -> None:
    folder = runs / config.name
    _check_same(config, folder, resume, pool.labelled)  # again, since another process may have started meanwhile
    fabric.seed_everything(config.seed, verbose=False)
    net = build(config.architecture, config.batch_norm, config.start).to(memory_format=torch.channels_last)
    if config.start:
        load_average(net, Path(config.start))
    kept = _from_teacher(net, runs / config.teacher) if config.teacher else []
    net = net.to(fabric.device)
    optimiser, schedule = _optimiser(net, config, fabric)
    average = copy.deepcopy(net).requires_grad_(False).eval()
    model, optimiser = fabric.setup(net, optimiser)
    average = average.to(fabric.device)
    state: dict[str, Any] = {"model": model, "optimiser": optimiser, "schedule": schedule, "ema": average}
    state |= {"step": 0, "seconds": 0.0, "often": torch.zeros(0)}
    if resume and (folder / "last.pt").exists():
        _restore(fabric, folder / "last.pt", state)
    fabric.barrier()
    if fabric.is_global_zero:
        _clear_after(state["step"], folder)
    run = _Run(config, folder, fabric, state, pool, overfit, kept)
    run.facts |= {"labelled": pool.labelled} if pool.labelled else {}
    try:
        if run.on_device is not None:
            run.go(run.numbers())
        else:
            run.go(fabric.setup_dataloaders(_loader(config, pool, state, workers, fabric)))
    finally:
        run.close()


def _restore(fabric: Fabric, path: Path, state: dict[str, Any]) -> None:
    """Fill `state` from a checkpoint, numbers and tensors only, since unpickling could execute arbitrary code."""
    try:
        fabric.load(path, state, weights_only=True)
    except (EOFError, KeyError, TypeError, ValueError, RuntimeError, pickle.UnpicklingError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise RcdnError(
            f"{path} is no checkpoint of `rcdn train` that fits: {reason}; begin anew with --fresh"
        ) from error


def _from_teacher(net: CornerNet, run: Path) -> list[torch.nn.Parameter]:
    """Initialise `net` from the averaged weights of a finished run, by `grow`;
    returns the teacher's parameters in it."""
    teacher, report = load_run(run)
    if (done := report["metrics"]["step"]) != (wanted := report["config"]["steps"]):
        raise ConfigError(f"config: the teacher {run} has {done} of its {wanted} steps; finish it first: rcdn train")
    return grow(net, without_norms(teacher))


def _pattern(config: TrainConfig) -> Pattern:
    """The pattern of the boards whose corners the network learns."""
    return "deltille" if PRESETS[config.pool.ranges].deltille_p else "checker"


def _check_same(config: TrainConfig, folder: Path, resume: bool, labelled: dict[str, Any] | None) -> None:
    """Raise ConfigError if the folder's run was started with other settings or labelled pictures, instead of resuming
    it."""
    if not resume or not (folder / "last.pt").exists():
        return
    report = read_report(folder)
    before: dict[str, Any] = report["config"]
    now = dataclasses.asdict(config) | {"validate_every": before["validate_every"]}  # doesn't affect training
    defaults = {f.name: f.default for f in dataclasses.fields(config)}  # of settings that are newer than the run
    changed = [key for key in now if before.get(key, defaults[key]) != now[key]]
    if not changed and report.get("labelled") != labelled:
        changed = ["other labelled pictures"]
    if changed:
        raise ConfigError(
            f"{folder} holds a run of other settings ({', '.join(changed)}); "
            "give the new one another `name`, or remove the old one with --fresh"
        )


def _clear_after(step: int, folder: Path) -> None:
    """Prepare the folder for a run that resumes at `step`: remove the log of later steps, and everything for step 0."""
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "metrics.csv"
    (folder / "new.pt").unlink(missing_ok=True)  # left by a run that was killed while writing
    if step and log.exists():
        head, *rows = log.read_text().splitlines()
        write_text(log, "\n".join([head, *(row for row in rows if int(row.split(",")[0]) <= step)]) + "\n")
    elif not step:
        for path in (folder / "last.pt", folder / "run.json", log, *folder.glob("events/events.*")):
            path.unlink(missing_ok=True)


def _optimiser(
    net: CornerNet, config: TrainConfig, fabric: Fabric
) -> tuple[torch.optim.Optimizer, torch.optim.lr_scheduler.LRScheduler]:
    if config.optimiser == "sgd":
        sgd = torch.optim.SGD(net.parameters(), config.rate, momentum=0.9, weight_decay=config.decay)
        return sgd, torch.optim.lr_scheduler.ExponentialLR(sgd, 0.01 ** (1 / config.steps))
    fused = fabric.device.type == "cuda"  # one kernel
    adam = torch.optim.AdamW(net.parameters(), config.rate, weight_decay=config.decay, fused=fused)
    return adam, torch.optim.lr_scheduler.OneCycleLR(adam, config.rate, config.steps, pct_start=0.1)


def _loader(config: TrainConfig, pool: Pool, state: dict[str, Any], workers: int, fabric: Fabric) -> Any:
    make = partial(_numbered, pool, config, fabric.global_rank, state)
    batches = Batches(make, state["step"], config.steps)
    count = 0 if config.mined else workers  # a worker wouldn't see what is mined
    return torch.utils.data.DataLoader(batches, batch_size=None, num_workers=count, worker_init_fn=_start_worker)


def _start_worker(_: int) -> None:
    end_with_parent()


def _windows(config: TrainConfig, pool: Pool, rank: int, often: torch.Tensor, step: int) -> Any:
    """What is random about the batch of a step."""
    room = pool.images.shape[1] - config.side
    probability = often.cpu().double().numpy() if len(often) else None
    return windows(len(pool), room, config.batch, config.normalisation, (config.seed, rank, step), probability)


def _numbered(pool: Pool, config: TrainConfig, rank: int, state: dict[str, Any], step: int) -> Any:
    chosen = _windows(config, pool, rank, state["often"], step)
    return cut(pool, chosen, ARCHITECTURES[config.architecture], config.side, config.normalisation, config.ring)


class _Run:
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

    def numbers(self) -> Any:
        """What the card needs for a batch, step by step."""
        assert self.on_device
        often = None
        for step in range(self.state["step"], self.config.steps):
            if often is not self.state["often"]:
                often = self.state["often"]
                host = often.cpu()
            yield self.on_device.numbers(_windows(self.config, self.pool, 0, host, step))

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
                if self.config.mined and step % self.config.mined == 0:
                    self.state["often"] = self.mined()
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
            loss, positive = self._replayed(*batch)
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
        loss = LOSSES[self.config.loss](z, goal)
        self.fabric.backward(loss)
        response = self._response(z.detach())
        return loss.detach(), (response * goal.positive).sum() / goal.positive.sum()

    def _response(self, z: torch.Tensor) -> torch.Tensor:
        return torch.relu(z) if ACTIVATION[self.config.loss] == "relu" else torch.sigmoid(z)

    def _replayed(self, *numbers: torch.Tensor) -> Any:
        """As `_gradients`, of the windows that `numbers` tells the card."""
        parameters = list(self.state["model"].parameters())
        if self.recorded is None:
            pool, side = self.on_device, self.config.side
            assert pool

            def work(*numbers: torch.Tensor) -> Any:
                for parameter in parameters:
                    parameter.grad = None
                whole, real = numbers
                return self._gradients(*pool.batch(whole, real, side, self.margins))

            self.recorded = Recorded(work, numbers, list(self.state["model"].buffers()))
            self.grads = [parameter.grad for parameter in parameters]
        for parameter, grad in zip(parameters, self.grads, strict=True):
            parameter.grad = grad
        return self.recorded(*numbers)

    @torch.no_grad()
    def mined(self) -> torch.Tensor:
        """Cumulative sum over the crops of their background's false response, by the averaged network."""
        net, found, size = self.state["ema"], [], self.pool.images.shape[1]
        side, config = size - (size - sum(self.margins)) % net.architecture.cell, self.config
        for start in range(0, len(self.pool), 100):
            chosen = whole(np.arange(start, min(start + 100, len(self.pool))))
            if self.on_device is None:
                image, goal = cut(self.pool, chosen, net.architecture, side, config.normalisation, config.ring)
                image = image.to(self.fabric.device)
            else:
                image, goal = self.on_device.batch(*self.on_device.numbers(chosen), side, self.margins)
            with torch.autocast(image.device.type, torch.float16, enabled=image.device.type == "cuda"):
                z = net(image)
            excess = (self._response(z.float()) - FALSE).clamp(0, 1)
            near = torch.nn.functional.max_pool2d(goal.positive.float().to(excess.device), 9, 1, 4) > 0
            found.append((excess * goal.weight.to(excess.device) * ~near).sum((1, 2)))
        total = torch.cat(found).double()
        return torch.cumsum(total if bool(total.sum() > 0) else torch.ones_like(total), 0)

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
        loss, positive = (float(total / self.count) for total in (self.loss_sum, self.positive_sum))
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
