"""The complete training loop. The same code runs on a CPU, a GPU, or many nodes (Lightning Fabric)."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import pickle
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import torch
from lightning_fabric import Fabric

from rcdn.children import end_with_parent
from rcdn.errors import ConfigError, RcdnError
from rcdn.io import write_text
from rcdn.synthetic import PRESETS
from rcdn.training.alone import alone
from rcdn.training.config import TrainConfig
from rcdn.training.labelled import fingerprint, labelled_pool, read_labelled
from rcdn.training.net import ARCHITECTURES, CornerNet, build, grow, load_average, load_run, read_report, without_norms
from rcdn.training.samples import Batches, Pool, cut, joined, make_pool
from rcdn.training.steps import Run, windows_of
from rcdn.types.plane import Pattern


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
    run = Run(config, folder, fabric, state, pool, overfit, kept)
    run.facts |= {"labelled": pool.labelled} if pool.labelled else {}
    try:
        if run.on_device is not None:
            run.go(run.numbers(run.on_device))
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


def _numbered(pool: Pool, config: TrainConfig, rank: int, state: dict[str, Any], step: int) -> Any:
    chosen = windows_of(config, pool, rank, state["often"], step)
    return cut(pool, chosen, ARCHITECTURES[config.architecture], config.side, config.normalisation, config.ring)
