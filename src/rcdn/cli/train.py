"""`rcdn train`: networks from configurations, on a CPU, a GPU or several machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.errors import ConfigError
from rcdn.terminal.options import parse_folder


def train(
    config: Annotated[
        list[Path],
        typer.Argument(metavar="CONFIG.toml…", help="What to train, one after the other: configs/train_q.toml."),
    ],
    runs: Annotated[
        Path,
        typer.Option(parser=parse_folder, metavar="DIR", help="Where runs and their pools of rendered crops are kept."),
    ] = Path("runs"),
    backgrounds: Annotated[
        str | None,
        typer.Option(
            metavar="DIR",
            help="A folder of photographs without boards, to put behind the rendered ones, instead of the one that the "
            "configuration names; none: drawn clutter only.",
        ),
    ] = None,
    labelled: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|DIR",
            help="Labelled pictures of your own, crops of which are mixed with the rendered ones: what rcdn detect "
            "--json wrote, once its errors are corrected, or a truth.json, or the folder of one; none: "
            "the configuration's aren't used.",
        ),
    ] = None,
    overfit: Annotated[
        int,
        typer.Option(min=0, metavar="N", help="Learn N crops by heart, to check that learning works: F1 goes to 1."),
    ] = 0,
    steps: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Steps, instead of the configuration's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, metavar="N", help="Seed, instead of the configuration's.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Begin anew, and remove what the run has so far.")] = False,
    threads: Annotated[int, typer.Option(min=0, help="Threads that torch computes with; 0: its own choice.")] = 0,
    workers: Annotated[int, typer.Option(min=0, help="Processes that prepare batches.")] = 1,
    accelerator: Annotated[str, typer.Option(help="Where to compute: auto, cpu, cuda or mps.")] = "auto",
    devices: Annotated[str, typer.Option(help="How many of them, on each machine: auto or a number.")] = "auto",
    nodes: Annotated[int, typer.Option(min=1, help="How many machines.")] = 1,
) -> None:
    """Train networks and keep the weights, log and TensorBoard events of each in RUNS/NAME.

    NAME is the configuration's, or the name of its file; a network that grows from another one (`teacher`) comes after
    it. A run that was stopped goes on where it was: run the same command again. Relative folders in the configuration
    start at the current directory. Needs: pip install 'rcdn[train]'.
    """
    chosen = [_settings(path, backgrounds, labelled, steps, seed) for path in config]
    import torch

    from rcdn.training.loop import train as learn

    if threads:
        torch.set_num_threads(threads)
    for settings in chosen:
        fabric = _fabric(accelerator, devices, nodes)
        folder = learn(settings, runs, overfit=overfit, workers=workers, resume=not fresh, fabric=fabric)
        if fabric.is_global_zero:
            typer.echo(f"{folder} is complete; its weights: rcdn export {folder} -o FILE.onnx")


def _settings(path: Path, backgrounds: str | None, labelled: str | None, steps: int | None, seed: int | None) -> Any:
    """The configuration, overridden by the options of the command line."""
    from rcdn.training.config import read_config

    config = read_config(path)
    changes: dict[str, Any] = {"steps": steps, "seed": seed}
    if backgrounds is not None:
        changes["pool"] = replace(config.pool, backgrounds="" if backgrounds == "none" else backgrounds)
    if labelled is not None:
        changes["labelled"] = "" if labelled == "none" else labelled
    return replace(config, **{key: value for key, value in changes.items() if value is not None})


def _fabric(accelerator: str, devices: str, nodes: int) -> Any:
    from lightning_fabric import Fabric
    from lightning_fabric.utilities.exceptions import MisconfigurationException

    try:
        return Fabric(accelerator=accelerator, devices=devices, num_nodes=nodes)
    except (MisconfigurationException, TypeError, ValueError, OverflowError) as error:
        raise ConfigError(f"--accelerator, --devices or --nodes: {error}") from error
