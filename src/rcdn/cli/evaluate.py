"""`rcdn evaluate`: the figures of the docs, each by one command."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO, StringIO
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.cli._group import one_line

app = typer.Typer(
    no_args_is_help=True, help="Measure: every figure in the docs comes from one of these.", rich_markup_mode=None
)
Json = Annotated[
    Path | None, typer.Option("--json", help="Also write the figures, with commit, date and machine, to this file.")
]


@app.command("scenes")
def scenes(
    count: Annotated[int, typer.Option(min=1, help="Rendered 640×480 scenes.")] = 300,
    json: Json = None,
) -> None:
    """Raw corners on rendered scenes: precision and recall at 4 px under each threshold of the paper's Table 2 (about 4 minutes)."""
    from rcdn.evaluation import scenes as suite

    rows = suite.table(count, os.cpu_count() or 1)
    _show(rows, json, "scenes", {"count": count, "first seed": suite.FIRST, "radius": suite.RADIUS, "size": [640, 480]})


@app.command("hard")
def hard(
    model: Annotated[list[str] | None, typer.Option(help="auto, paper, or an .onnx file; may be given again.")] = None,
    json: Json = None,
) -> None:
    """F1 at 2 px on the fixed hard validation crops: noise to 60, blur to 4 px, contrast from 18 grey levels, tilt to 75° (a minute)."""
    from rcdn.evaluation import hard as suite

    models = tuple(model or ("auto", "paper"))
    _show(suite.table(models), json, "hard", {"models": models})


@app.command("detections")
def detections(
    found: Annotated[Path, typer.Argument(metavar="DETECTIONS.json", help="What `rcdn detect --json` wrote.")],
    truth: Annotated[
        Path, typer.Argument(metavar="TRUTH.json", help="The true corners, as `rcdn render` writes them.")
    ],
    json: Json = None,
) -> None:
    """Score a file of detections against the truth: whole boards, recall, wrong corners and labels, false alarms."""
    from rcdn.evaluation import detections as suite

    _show(suite.table(found, truth), json, "detections", {"detections": str(found), "truth": str(truth)})


@app.command("sweep")
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
    plots: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also draw a picture a factor (needs the extra `plot`).")
    ] = None,
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
    from rcdn.evaluation import sweep as suite
    from rcdn.io import check_writable

    if preset not in ("auto", "paper"):
        raise ConfigError(f"--preset must be auto or paper, not {preset!r}")
    for path in (json, csv):
        if path is not None:
            check_writable(path)
    names, lacking = suite.contestants([name.strip() for name in peers.split(",") if name.strip()])
    with _bar("sweeping") as step:
        rows = suite.table(count, factor or (), names, preset, workers or os.cpu_count() or 1, step)
    if plots is not None:
        _plot(rows, plots)
    if csv is not None:
        _write_csv(rows, csv)
    _show(rows, json, "sweep", suite.settings_of(count, preset, names) | {"skipped": lacking})
    for name, reason in lacking.items():
        typer.echo(f"skipped {name}: {one_line(reason)}")


@contextmanager
def _bar(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """What to call with (done, total), to be shown as a bar on a terminal; None where there is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def _plot(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """One PNG a factor. Raises RcdnError if matplotlib isn't installed or the folder can't be written."""
    from rcdn.errors import RcdnError
    from rcdn.io import write_bytes
    from rcdn.report.sweep_plot import draw_factor

    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise RcdnError("--plots needs matplotlib: pip install 'rcdn[plot]'") from error
    for factor in dict.fromkeys(row["factor"] for row in rows):
        figure = Figure(figsize=(8, 8), layout="constrained")
        draw_factor(figure, factor, rows)
        data = BytesIO()
        figure.savefig(data, format="png", dpi=110)
        write_bytes(folder / f"sweep_{factor}.png", data.getvalue())


def _write_csv(rows: Sequence[dict[str, Any]], path: Path) -> None:
    from csv import DictWriter

    from rcdn.io import write_text

    text = StringIO()
    writer = DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def _cell(column: str, value: Any) -> str:
    if value is None:
        return "-"
    digits = 2 if column in ("ratio", "z") else 4
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def _show(rows: list[dict[str, Any]], json: Path | None, suite: str, settings: dict[str, Any]) -> None:
    """Print a table, and save it if wanted."""
    from rcdn.evaluation.results import save
    from rcdn.provenance import provenance

    columns = list(rows[0])
    cells = [
        columns,
        *[[_cell(c, row[c]) for c in columns] for row in rows],
    ]
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    for line in cells:
        typer.echo(
            "  ".join(
                text.ljust(width) if k == 0 else text.rjust(width)
                for k, (text, width) in enumerate(zip(line, widths, strict=True))
            )
        )
    facts = provenance()
    typer.echo(f"rcdn {facts['rcdn']} at {facts['commit']}, {facts['date']}, {facts['platform']}, {facts['cpus']} CPUs")
    if json is not None:
        save(json, suite, settings, rows)


@app.command("recovery")
def recovery(
    count: Annotated[int, typer.Option(min=1, help="Pictures a kind.")] = 6,
    least: Annotated[int, typer.Option(min=4, help="Fewest corners of a board.")] = 9,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also draw both side by side, and the sheet recovery.jpg, into it."),
    ] = None,
    json: Json = None,
) -> None:
    """The paper's board recovery (growth) and ours (graph) on the same corners of the same rendered pictures (3 minutes).

    Flat, tilted, distorted, bent, covered and cut boards, several, none. `whole`: boards with all visible corners, no other,
    and right labels; `wrong`: corners of boards that are none; `labels`: boards with a wrong label; `false`: boards where none is.
    """
    from rcdn.evaluation import recovery as suite
    from rcdn.report.recovery import Gallery

    gallery = Gallery()
    with _bar("recovering") as step:
        rows = suite.table(count, least, step, gallery.add if pictures is not None else None)
    if pictures is not None:
        gallery.write(pictures)
    _show(rows, json, "recovery", {"count": count, "least": least, "first seed": suite.FIRST})


@app.command("calibration")
def calibration(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="The folder that holds the sets' folders.")],
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME|NAME:PATTERN:COLSxROWS:MODEL",
            help="A known set, or pictures of one camera: a pattern in DATA, inner corners, lens model "
            "(pinhole, brown, rational, fisheye). May be given again; default: all known sets.",
        ),
    ] = None,
    detectors: Annotated[
        str, typer.Option(metavar="NAME,…", help="auto, paper, auto-fit, auto-first, and peers.")
    ] = "auto,paper,opencv,opencv-sb,boofcv-size",
    warp: Annotated[bool, typer.Option("--warp", help="On common pictures, let the board be bent a little.")] = False,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
    markdown: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also write the tables of docs/calibration-results.md to this file."),
    ] = None,
) -> None:
    """Calibrations from the corners of several detectors by one solver, on photographs: the paper's section 4.4.

    `on all`: all boards that a detector found, outliers left out; `on common`: the pictures in which everybody found the
    whole board, everybody's same corners, equal weights, none left out; `on agreed`: these without anybody's outliers;
    `on with NAME`: pictures in common with one that finds too few whole boards to be compared with all.
    Root mean square lengths of the reprojection errors, px: `fit`: calibrated from all; `cal` and `pose`: calibrated from
    half of the pictures, and poses only on the other half, both directions, median of 5 splits; `unsteady`: worst split ÷
    median; `folds`: poses of held-out fifths; `camera`: the same with these cameras, but poses and errors of the peers'
    corners: one measure for everybody. `auto, by sigma`: each corner weighs by its sigma.
    """
    from rcdn.cli._cache import Cache, fingerprint, open_cache
    from rcdn.config import DetectorConfig
    from rcdn.evaluation import calibration as suite
    from rcdn.io import check_writable, write_text

    for path in (json, markdown):
        if path is not None:
            check_writable(path)
    opened = open_cache(DetectorConfig(), cache)
    assert opened is not None
    folder = opened.folder
    names = [name.strip() for name in detectors.split(",") if name.strip()]
    found, missing = suite.contestants(names, fingerprint, lambda salt: Cache(folder, salt))
    with _bar("looking for boards") as step:
        rows = suite.table(data, chosen := suite.chosen(sets or ()), found, missing, warp, step)
    if markdown is not None:
        write_text(markdown, suite.markdown(rows))
    _show(rows, json, "calibration", suite.settings_of(chosen, found, warp) | {"skipped": missing})


@app.command("trust")
def trust(
    runs: Annotated[int, typer.Option(min=3, help="Calibrations of each lens model.")] = 200,
    models: Annotated[
        str, typer.Option(metavar="NAME,…", help="Lens models to simulate.")
    ] = "pinhole,brown,fisheye,rational",
    json: Json = None,
) -> None:
    """Do the stated standard deviations hold? Simulated calibrations, and how often the truth lies within them.

    Each run: 20 views of a 9×6 board, parts included, noise of 0.1, 0.3 and 1 px in turn, 5 % of the corners thrown 5 to 40 px away.
    `within`: share of all parameters within one standard deviation (chance: .683), `within2` within two (.954), `spread`: root mean
    square of error ÷ deviation (1). About 15 minutes on one core.
    """
    from rcdn.errors import ConfigError
    from rcdn.evaluation import trust as suite
    from rcdn.io import check_writable

    names = [name.strip() for name in models.split(",") if name.strip()]
    if unknown := [n for n in names if n not in suite.MODELS]:
        raise ConfigError(f"--models: {unknown[0]!r} isn't one of {', '.join(suite.MODELS)}")
    if json is not None:
        check_writable(json)
    rows = []
    with _bar("calibrating") as step:
        for k, name in enumerate(names):
            rows.append(suite.row(suite.trust(name, runs)))
            if step is not None:
                step(k + 1, len(names))
    _show(rows, json, "trust", {"runs": runs, "views": 20, "noise": list(suite.NOISES), "outliers": suite.OUTLIERS})
