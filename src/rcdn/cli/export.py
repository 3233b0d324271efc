"""`rcdn export`: trained weights as an ONNX file for `rcdn detect`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.errors import ConfigError


def export(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN_DIR...",
            help="The folder of a run of `rcdn train`, several that grew from one network, whose weights are averaged, "
            "or an exported .onnx file.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.onnx",
            help="Where to write; a .json goes beside it. Default: in RUN_DIR, if that is one.",
        ),
    ] = None,
) -> None:
    """Write a trained network as ONNX, with its provenance as JSON beside it.

    Before anything is written, ONNX Runtime must give the same responses as torch, within 1e-4, on a rendered picture.
    The cell network, which runs in whole numbers of 8 bits, also gets a .npz file of these, once they answer as the
    network does on 100 pictures of the validation set. Of an exported .onnx file only that is made anew. Needs: pip
    install 'rcdn[train]'.
    """
    run = runs[0]
    if any(each.is_file() for each in runs):
        if len(runs) > 1:
            raise ConfigError("export: several networks are averaged from the folders of their runs; name these")
        if output is not None:
            raise ConfigError("export: the 8-bit weights of an exported network go beside it: leave --output out")
        from rcdn.training.quantise import store

        figures = store(run)
        typer.echo(f"wrote {run.with_suffix('.npz')} and {run.with_suffix('.json').name}")
        _echo_quantised(figures)
        return
    from rcdn.training.export import PARITY
    from rcdn.training.export import export as write

    if len(runs) > 1 and output is None:
        raise ConfigError("export: name the file for the mean of several runs, --output FILE.onnx")
    target = output or run / f"{run.resolve().name}.onnx"
    facts, gap = write(runs, target)
    metrics = facts["metrics"]
    typer.echo(f"wrote {target} and {target.with_suffix('.json').name}")
    if len(runs) > 1:
        typer.echo(f"the mean of the weights of {len(runs)} runs")
    typer.echo(f"network {facts['architecture']}, {facts['parameters']:,} parameters, {metrics['step']:,} steps")
    typer.echo(f"F1 {metrics['f1']} on the validation set")
    typer.echo(f"largest difference between torch and ONNX Runtime: {gap:.1e} (at most {PARITY:.0e} is accepted)")
    if "quantised" in facts:
        _echo_quantised(facts["quantised"])


def _echo_quantised(figures: dict[str, Any]) -> None:
    """Print the effect of quantisation to 8 bits."""
    from rcdn.training.quantise import BOUNDS

    for name, most in BOUNDS.items():
        typer.echo(
            f"8 bits on {figures['pictures']} pictures: {name} {figures[name]:.4f} (at most {most:g} is accepted)"
        )
