"""`rcdn evaluate fig4`, `fig5` and `fig6`: the figures of the paper's sections 4.2 and 4.3."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn_lab.cli.evaluate._table import Csv, Json, Workers, bar, check_files, show, write_csv, write_png

Full = Annotated[bool, typer.Option("--full", help="The paper's size; see above for the time.")]
Plots = Annotated[Path | None, typer.Option("--plots", metavar="DIR", help="Also draw the figure into it.")]
Markdown = Annotated[
    Path | None, typer.Option("--markdown", metavar="FILE", help="Also write the tables of docs/paper-results.md.")
]
Trials = Annotated[int | None, typer.Option(min=1, help="Pictures a cell or level instead of the usual ones.")]
Rcdn = Annotated[str, typer.Option("--rcdn", metavar="NAME|FILE.onnx", help="Weights of RCDN (model F).")]
Mate = Annotated[str, typer.Option("--mate", metavar="NAME|FILE.onnx", help="Weights of MATE (net A, squared loss).")]


def fig4(
    full: Full = False,
    trials: Trials = None,
    rcdn: Rcdn = "paper",
    mate: Mate = "tables/mate",
    workers: Workers = 0,
    json: Json = None,
    csv: Csv = None,
    plots: Plots = None,
    markdown: Markdown = None,
) -> None:
    """Figure 4: how far RCDN's, MATE's and ChESS' highest response is from the corner, over noise and rotation.

    Corners of 64 and 191 with a line of 128, without and with 3×3 pre-blur; noise 0 to 100, rotation 0° to 90°; the
    highest response of the central 41×41 of 81×81 px, no refinement. Printed: means over all angles. `hit`: within 1
    px; `miss`: more than 4 px off, or no answer; `worst px`: the worst angle's mean. Then the paper's
    claims, with our figures.

    Steps of 10 (noise) and 5°, 100 pictures a cell: 3 minutes of one core; --full: steps of 1, 1000 pictures: 20 hours.
    """
    _pixel_error("fig4", full, trials, (rcdn, mate), workers, (json, csv, plots, markdown))


def fig5(
    full: Full = False,
    trials: Trials = None,
    rcdn: Rcdn = "paper",
    mate: Mate = "tables/mate",
    workers: Workers = 0,
    json: Json = None,
    csv: Csv = None,
    plots: Plots = None,
    markdown: Markdown = None,
) -> None:
    """Figure 5: how far RCDN's, MATE's and ChESS' highest response is from the corner, over noise and tilt.

    As fig4, with a tilt of 0° to 70° about an axis at 45° to the squares' edges, which cross at 2 atan(cos tilt).

    About 3 minutes of one core; --full: 15 hours.
    """
    _pixel_error("fig5", full, trials, (rcdn, mate), workers, (json, csv, plots, markdown))


def fig6(
    full: Full = False,
    trials: Trials = None,
    factor: Annotated[
        list[str] | None, typer.Option(help="noise, blur, rotation, tilt (all, if not given); may be given again.")
    ] = None,
    rcdn: Rcdn = "paper",
    workers: Workers = 0,
    json: Json = None,
    csv: Csv = None,
    plots: Plots = None,
    markdown: Markdown = None,
) -> None:
    """The second Figure 5 of the paper: mean error, px, of sub-pixel refinements over noise, blur, rotation and tilt.

    Corners of 64 and 191 anywhere within a pixel, 80×80 px; one factor at a time, the others low (noise 2, blur 1 px,
    10°, 10°). From the highest response (seed) go: centre of mass (CoM), Gaussian peak (Gauss), parabola, cornerSubPix
    (OpenCV), surface fit (ROCHADE), the paper's mean of Gauss and ROCHADE (mixed), the first refinement of the preset
    auto (ours, first) and a fit of two blurred edges (ours, fit). In brackets: failures, whose start counts. Then the
    paper's claims, with our figures.

    200 pictures a level: a minute of one core; --full: 1000 pictures, 4 minutes.
    """
    from rcdn_lab.paper import refinement_claims, refinements
    from rcdn_lab.paper.claim import lines

    files = (json, csv, plots, markdown)
    check_files(json, csv, markdown, plots=plots)
    count = trials or (1000 if full else 200)
    with bar("refining") as step:
        rows = refinements.table(count, factor or (), rcdn, workers or os.cpu_count() or 1, step)
    claims = refinement_claims.claims(rows)
    settings = {
        "trials": count, "size": refinements.SIZE, "region": refinements.REGION, "first seed": refinements.FIRST,
        "low levels": vars(refinements.BASE), "weights": _weights({"RCDN": rcdn}),
    }  # fmt: skip
    show(refinement_claims.summary(rows), None, "fig6", settings)
    console.print_line("\n".join(lines(claims)))
    _write("fig6", rows, settings | {"claims": [vars(c) for c in claims]}, files, refinement_claims.markdown)


def _pixel_error(
    figure: str,
    full: bool,
    trials: int | None,
    weights: tuple[str, str],
    workers: int,
    files: tuple[Path | None, Path | None, Path | None, Path | None],
) -> None:
    """Figs. 4 and 5; `weights` of RCDN and MATE; `files`: JSON, CSV, folder of plots, Markdown."""
    from rcdn_lab.paper import pixel_claims, pixel_error
    from rcdn_lab.paper.claim import lines

    json, csv, plots, markdown = files
    check_files(json, csv, markdown, plots=plots)
    methods, lacking = pixel_error.contestants(*weights)
    grid = pixel_error.grid(figure, full, trials)
    with bar("looking for corners") as step:
        rows = pixel_error.table(grid, methods, workers or os.cpu_count() or 1, step)
    claims = pixel_claims.claims(rows)
    settings = {
        "grid": vars(grid), "size": pixel_error.SIZE, "region": pixel_error.REGION, "first seed": pixel_error.FIRST,
        "weights": _weights(methods), "skipped": lacking,
    }  # fmt: skip
    show(pixel_error.summary(rows), None, figure, settings)
    for name, reason in lacking.items():
        console.print_line(f"skipped {name}: {one_line(reason)}")
    console.print_line("\n".join(lines(claims)))
    outcome = {"claims": [vars(c) for c in claims], "cells not won": pixel_claims.not_won(rows)}
    _write(figure, rows, settings | outcome, files, pixel_claims.markdown)


def _weights(names: dict[str, str]) -> dict[str, dict[str, str]]:
    """Method → name and checksum of its weights."""
    from rcdn_lab.table_weights import load_network

    return {m: {"name": n, "sha256": load_network(n).facts["sha256"]} for m, n in names.items() if n}


def _write(
    suite: str,
    rows: Sequence[dict[str, Any]],
    settings: dict[str, Any],
    files: tuple[Path | None, Path | None, Path | None, Path | None],
    tables: Callable[[Sequence[dict[str, Any]]], str],
) -> None:
    """Write all rows as JSON and CSV, the figure, and the short tables."""
    from rcdn.io import write_text
    from rcdn_lab.results import save

    json, csv, plots, markdown = files
    if json is not None:
        save(json, suite, settings, list(rows))
    if csv is not None:
        write_csv(rows, csv)
    if plots is not None:
        _plot(suite, rows, plots)
    if markdown is not None:
        write_text(markdown, tables(rows))


def _plot(suite: str, rows: Sequence[dict[str, Any]], folder: Path) -> None:
    from matplotlib.figure import Figure

    from rcdn_lab.plots.pixel_error_plot import draw_pixel_error
    from rcdn_lab.plots.refinement_plot import draw_refinements

    figure = Figure(layout="constrained")
    (draw_refinements if suite == "fig6" else draw_pixel_error)(figure, rows)
    write_png(figure, folder / f"{suite}.png")
