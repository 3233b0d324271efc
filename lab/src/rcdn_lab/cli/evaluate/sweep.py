"""`rcdn evaluate sweep`: one factor at a time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show, write_csv, write_png


def sweep(
    count: Annotated[int, typer.Option(min=1, help="Pictures a level.")] = 20,
    factor: Annotated[
        list[str] | None, typer.Option(help="noise, blur, tilt, … (all, if not given); may be given again.")
    ] = None,
    peers: Annotated[
        str, typer.Option(metavar="auto|none|NAME,…", help="Other detectors to run on the same pictures; auto: all.")
    ] = "auto",
    preset: Annotated[str, typer.Option(metavar="auto|paper", help="Settings of our detector.")] = "auto",
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
    json: Json = None,
    csv: Annotated[Path | None, typer.Option(help="Also write the table to this file.")] = None,
    plots: Annotated[Path | None, typer.Option(metavar="DIR", help="Also draw a picture a factor.")] = None,
) -> None:
    """Rendered boards with exact truth, one factor at a time, and pairs of them.

    Noise, blur, motion, tilt, distortion, contrast, light, JPEG, size of the squares, covers, the frame, bent boards,
    several boards, none. Success: every board has all its visible corners, no other, and right labels. `wrong`: corners
    that are none; `mislabelled`: boards with a wrong label; `false`: boards where none is; `bound px`: mean error of an
    efficient estimator that looks at one corner alone (Cramér–Rao); `ratio`: mean error ÷ bound, below 1 where corners
    of a board help each other; `z`: error ÷ sigma, 1 if that is honest; `failed`: pictures on which a detector broke
    down, which count as nothing found. Peers that must know the board's size are told it (`size`).

    At 5 pictures a level our detector alone takes some 7 minutes of one core.
    """
    from rcdn.errors import ConfigError
    from rcdn_lab import sweep as suite

    if preset not in ("auto", "paper"):
        raise ConfigError(f"--preset must be auto or paper, not {preset!r}")
    check_files(json, csv, plots=plots)
    names, lacking = suite.contestants([name.strip() for name in peers.split(",") if name.strip()])
    with bar("sweeping") as step:
        rows = suite.table(count, factor or (), names, preset, workers or os.cpu_count() or 1, step)
    if plots is not None:
        _plot(rows, plots)
    if csv is not None:
        write_csv(rows, csv)
    show(rows, json, "sweep", suite.settings_of(count, preset, names) | {"skipped": lacking})
    for name, reason in lacking.items():
        console.print_line(f"skipped {name}: {one_line(reason)}")


def _plot(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """One PNG for each factor."""
    from matplotlib.figure import Figure

    from rcdn_lab.plots.sweep_plot import draw_factor

    for factor in dict.fromkeys(row["factor"] for row in rows):
        figure = Figure(figsize=(8, 8), layout="constrained")
        draw_factor(figure, factor, rows)
        write_png(figure, folder / f"sweep_{factor}.png")
