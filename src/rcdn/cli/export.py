"""`rcdn export`: trained weights as an ONNX file that `rcdn detect` can use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="The folder of a run of `rcdn train`.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.onnx", help="Where to write; a .json goes beside it. Default: in RUN_DIR."
        ),
    ] = None,
) -> None:
    """Write a trained network as ONNX, with its provenance as JSON beside it.

    Before anything is written, ONNX Runtime must give the same responses as torch, within 1e-4, on a rendered picture.
    Needs: pip install 'rcdn[train]'.
    """
    from rcdn.training.export import PARITY
    from rcdn.training.export import export as write

    target = output or run / f"{run.resolve().name}.onnx"
    facts, gap = write(run, target)
    metrics = facts["metrics"]
    typer.echo(f"wrote {target} and {target.with_suffix('.json').name}")
    typer.echo(f"network {facts['architecture']}, {facts['parameters']:,} parameters, {metrics['step']:,} steps")
    typer.echo(f"F1 {metrics['f1']} on the validation set")
    typer.echo(f"largest difference between torch and ONNX Runtime: {gap:.1e} (at most {PARITY:.0e} is let out)")
