"""`rcdn bench`: time and memory of detection, compared with other detectors."""

from __future__ import annotations

import json as as_json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.errors import ConfigError
from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn.terminal.options import GridSize, parse_size
from rcdn_lab.cli.bench_words import PARTS, counts_of, parts_of, sizes_of, words_of
from rcdn_lab.cli.columns import columns

FRESH = 5
"""fresh interpreters for the first calls"""
SWEEP = Path("benchmarks/results/sweep_peers.json")


@dataclass
class _Results:
    """The tables by name, and what was skipped; `samples`: memory over a folder; `chosen`: photographs."""

    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    samples: list[dict[str, Any]] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    chosen: list[str] = field(default_factory=list)


app = typer.Typer(rich_markup_mode=None)


@app.command(short_help="Measure time and memory.")
def bench(
    count: Annotated[int, typer.Option(min=1, help="Repeats of each measurement.")] = 20,
    peers: Annotated[
        str, typer.Option(metavar="auto|none|NAME,…", help="Other detectors on the same pictures; auto: all.")
    ] = "auto",
    preset: Annotated[
        list[str] | None, typer.Option(metavar="auto|paper", help="Settings of our detector; may be given again.")
    ] = None,
    sizes: Annotated[
        str, typer.Option(metavar="WIDTHxHEIGHT,…", help="Sizes of the pictures, px.")
    ] = "640x480,1920x1080,4000x3000",
    threads: Annotated[str, typer.Option(metavar="N,…", help="Numbers of threads, and of cores to run on.")] = "1,2",
    board: Annotated[
        GridSize, typer.Option(parser=parse_size, metavar="COLSxROWS", help="The board's inner corners.")
    ] = "9x6",  # type: ignore[assignment]  # Typer parses defaults, too
    budget: Annotated[
        float, typer.Option(min=0, help="Seconds a detector may take on one picture; then it repeats less.")
    ] = 6.0,
    photographs: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Time photographs: of the sets in its truth.json, or all; then no other part."
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="With --photographs: repeats of each picture.")] = 3,
    parts: Annotated[
        str | None,
        typer.Option(metavar="NAME,…|none", help=f"Of {', '.join(PARTS)}; default: all, without --photographs."),
    ] = None,
    stages: Annotated[bool, typer.Option("--stages", help="Also what each stage of our detector takes.")] = False,
    folder: Annotated[
        int, typer.Option(min=0, metavar="N", help="Also `rcdn detect` over N rendered pictures: time and memory.")
    ] = 0,
    folder_jobs: Annotated[str, typer.Option(metavar="N,…", help="With --folder: the numbers of jobs.")] = "1,2",
    folder_plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --folder: draw time and memory along the pictures."),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(
            "--json", help="Also write the figures, with commit, date and machine, to this file; - is standard output."
        ),
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="Also write the memory along the folder to this file.")] = None,
    markdown: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the tables of docs/speed.md.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also draw time against quality, and memory."),
    ] = None,
    sweep: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help=f"Where --plot has the quality from, of `rcdn evaluate sweep`; default: {SWEEP}."
        ),
    ] = None,
) -> None:
    """Time from a grey picture to labelled boards, ours and other detectors', and memory.

    All detectors in turn on the same pictures, each in a process of its own that may use as many cores as threads.
    `ms`: median of the repeats, `iqr ms`: from their first quartile to their third; `cpu ms`: of all cores; `ratio`:
    median of its time ÷ findChessboardCornersSB's on the same picture in the same round; `corners`: in boards. A
    detector that isn't installed, breaks down, or takes longer than the budget says so. `rate`: operations a second of
    the preset `paper`'s network, beside products of matrices. With `--photographs`: figures a megapixel, geometric
    means over the sets. At most 15 minutes; the machine must be idle.
    """
    from rcdn_lab.bench import record

    console.begin(outputs=(json, csv, markdown))
    wanted = parts_of(parts or (",".join(PARTS) if photographs is None else "none"))
    frames, counts = sizes_of(sizes), counts_of(threads)
    drawn = _prepared(plot, sweep) if plot is not None else None
    along = counts_of(folder_jobs, "--folder-jobs")
    _check(json, csv, markdown, plot, folder, folder_plot)
    who, skipped = _contestants(preset or ["auto"], peers, counts)
    machine = record.machine()
    if record.busy(machine["load"]):
        typer.echo(f"note: the machine is busy (load {machine['load']}): these times are not worth much", err=True)
    results = _Results(skipped=skipped)
    if photographs is not None:
        _photographs(results, photographs, (board.cols, board.rows), who, counts, rounds, stages)
    _measure(results, wanted, who, frames, board, counts, count, budget)
    if stages and photographs is None:
        _stages(results, preset or ["auto"], frames, board, count, budget)
    if folder:
        _folder(results, folder, along, folder_plot)
    settings = {
        "count": count, "budget": budget, "sizes": frames, "board": board, "threads": counts,
        "photographs": None if photographs is None else photographs.resolve().name,
        "rounds": None if photographs is None else rounds, "chosen": results.chosen, "folder": folder,
        "folder jobs": along if folder else None, "peers": _versions(who), "skipped": skipped,
        "machine": machine | {"load after": record.load()},
    }  # fmt: skip
    if drawn is not None and plot is not None:
        from rcdn_lab.plots.bench_plot import draw

        quality, speed = drawn, results.tables.get("speed", [])
        _draw(plot, lambda figure: draw(figure, speed, quality, results.samples))
    _write(results, settings, json, csv, markdown)
    _show(results)


# ---- options


def _check(
    json: Path | None, csv: Path | None, markdown: Path | None, plot: Path | None, folder: int, along: Path | None
) -> None:
    """Raise before the work if its results could not be written."""
    from rcdn.io import check_writable

    if csv is not None and not folder:
        raise ConfigError("--csv holds the memory along a folder: give --folder N, too")
    if along is not None:
        if not folder:
            raise ConfigError("--folder-plot draws time and memory along a folder: give --folder N, too")
        _check_plot("--folder-plot", along)
    for path in (json, csv, markdown, plot, along):
        if path is not None:
            check_writable(path)


def _prepared(plot: Path, sweep: list[Path] | None) -> dict[str, float]:
    """Detector → quality, for the plot. Raises if it cannot be drawn."""
    from rcdn_lab.bench.record import quality

    _check_plot("--plot", plot)
    return quality(sweep or [SWEEP])


def _check_plot(option: str, path: Path) -> None:
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise ConfigError(f"{option} {path}: the name must end in .png, .svg or .pdf")


def _contestants(presets: list[str], peers: str, threads: list[int]) -> tuple[list[Any], dict[str, str]]:
    from rcdn.batch.pool import usable_cores
    from rcdn_lab.bench.run import contestants

    if max(threads) > usable_cores():
        typer.echo(f"note: there are only {usable_cores()} cores for {max(threads)} threads", err=True)
    return contestants(presets, words_of(peers))


# ---- measuring


def _measure(
    results: _Results, wanted: list[str], who: list[Any], frames: list[tuple[int, int]], board: GridSize,
    threads: list[int], count: int, budget: float,
) -> None:  # fmt: skip
    from rcdn_lab.bench.first import first_calls, memory
    from rcdn_lab.bench.rate import rate
    from rcdn_lab.bench.run import cells_of, table

    size = (board.cols, board.rows)
    with _step_display() as describe:
        if "speed" in wanted:
            cells = cells_of(frames, size, who)
            results.tables["speed"] = table(cells, who, threads, count, budget, describe)
        if "first" in wanted:
            describe("first calls")
            results.tables["first"] = first_calls(size, min(count, FRESH))
        if "memory" in wanted:
            results.tables["memory"] = memory(frames, size, who, max(threads), describe)
        if "rate" in wanted:
            describe("rate of the dense network and of matrix products")
            results.tables["rate"] = rate(count)


def _photographs(
    results: _Results,
    folder: Path,
    default_size: tuple[int, int],
    who: list[Any],
    threads: list[int],
    rounds: int,
    stages: bool,
) -> None:
    from rcdn_lab.bench import yardstick
    from rcdn_lab.bench.chosen import chosen
    from rcdn_lab.bench.photographs import PATIENCE, figures
    from rcdn_lab.bench.stages import photograph_stages

    pictures = chosen(folder, default_size)
    results.chosen = [f"{picture.set}/{picture.file}" for picture in pictures]
    with _step_display() as describe:
        found, failures = figures(pictures, who, threads, rounds, PATIENCE, describe)
        results.skipped |= {name: f"failed on some photographs: {why}" for name, why in failures.items()}
        results.tables["photographs"] = yardstick.summary(found)
        results.tables["sets"], results.tables["found"] = yardstick.sets(found), yardstick.found(found)
        if stages:
            results.tables["photograph stages"] = photograph_stages(pictures, "auto", rounds, describe)


def _stages(
    results: _Results, presets: list[str], frames: list[tuple[int, int]], board: GridSize, count: int, budget: float
) -> None:
    from rcdn_lab.bench.stages import stages

    with _step_display() as describe:
        results.tables["stages"] = [
            row for p in presets for row in stages(frames, (board.cols, board.rows), p, count, budget, describe)
        ]


def _folder(results: _Results, count: int, jobs: list[int], plot: Path | None) -> None:
    from rcdn_lab.bench.folder import watch

    with _step_display() as describe:
        found = watch([sys.executable, "-m", "rcdn_lab.bench.watch"], jobs, count, describe)
    results.tables["folder"], results.samples = found["rows"], found["samples"]
    if plot is not None:
        from rcdn_lab.plots.bench_plot import draw_folder

        _draw(plot, lambda figure: draw_folder(figure, results.samples))


def _step_display() -> Any:
    """A context with a function to call with the present step: shown on a terminal only."""
    from contextlib import contextmanager

    from rcdn.terminal.progress import progress

    @contextmanager
    def open_bar() -> Any:
        with progress(0) as bar:
            yield bar.describe

    return open_bar()


# ---- output


def _versions(who: Sequence[Any]) -> dict[str, str]:
    from rcdn_lab.peers import PEERS

    return {c.name: PEERS[c.name].version() for c in who if c.name in PEERS}


def _draw(path: Path, draw: Callable[[Any], None]) -> None:
    from matplotlib.figure import Figure

    from rcdn.io import write_bytes

    figure = Figure(layout="constrained")
    draw(figure)
    data = BytesIO()
    figure.savefig(data, format=path.suffix[1:].lower(), dpi=110)
    write_bytes(path, data.getvalue())


def _write(
    results: _Results, settings: dict[str, Any], json: Path | None, csv: Path | None, markdown: Path | None
) -> None:
    from rcdn.io import write_text
    from rcdn.provenance import provenance
    from rcdn_lab.bench.record import markdown as text_of

    if json is not None:
        head = {"suite": "bench", "provenance": provenance(), "settings": settings}
        write_text(json, as_json.dumps(head | results.tables | {"samples": results.samples}, indent=1) + "\n")
    if csv is not None:
        columns = list(results.samples[0])
        lines = [columns, *[["" if s[c] is None else str(s[c]) for c in columns] for s in results.samples]]
        write_text(csv, "".join(",".join(line) + "\n" for line in lines))
    if markdown is not None:
        write_text(markdown, text_of(results.tables))


def _show(results: _Results) -> None:
    from rcdn.provenance import provenance

    for name, rows in results.tables.items():
        console.print_line(name)
        for line in columns(rows):
            console.print_line(line)
        console.print_line("")
    for name, reason in results.skipped.items():
        console.print_line(f"skipped {name}: {one_line(reason)}")
    facts = provenance()
    console.print_line(
        f"rcdn {facts['rcdn']} at {facts['commit']}, {facts['date']}, {facts['platform']}, {facts['cpus']} CPUs"
    )
