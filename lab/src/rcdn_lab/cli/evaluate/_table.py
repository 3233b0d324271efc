"""Helpers shared by all suites: a progress bar, the table on the terminal, files of figures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO, StringIO
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.terminal import console

Json = Annotated[
    Path | None,
    typer.Option(
        "--json", help="Also write the figures, with commit, date and machine, to this file; - is standard output."
    ),
]


Csv = Annotated[Path | None, typer.Option("--csv", help="Also write all rows to this file.")]
Workers = Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")]


@contextmanager
def bar(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """A function to call with (done, total), which updates a bar on a terminal; None if there is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def check_files(*paths: Path | None, plots: Path | None = None) -> None:
    """Check before the work that the files can be written, and that figures can be drawn in the folder `plots`.
    Messages go to standard error if one of the files is standard output."""
    from rcdn.io import check_writable

    console.begin(outputs=paths)
    for path in paths:
        if path is not None:
            check_writable(path)


def write_png(figure: Any, path: Path) -> None:
    """Write a matplotlib figure, whole or not at all."""
    from rcdn.io import write_bytes

    data = BytesIO()
    figure.savefig(data, format="png", dpi=110)
    write_bytes(path, data.getvalue())


def write_csv(rows: Sequence[dict[str, Any]], path: Path) -> None:
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


def show(rows: list[dict[str, Any]], json: Path | None, suite: str, settings: dict[str, Any]) -> None:
    """Print a table, and save it if requested; on standard error if standard output is used for the file."""
    from rcdn.provenance import provenance
    from rcdn_lab.results import save

    columns = list(rows[0])
    cells = [
        columns,
        *[[_cell(c, row[c]) for c in columns] for row in rows],
    ]
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    for line in cells:
        console.print_line(
            "  ".join(
                text.ljust(width) if k == 0 else text.rjust(width)
                for k, (text, width) in enumerate(zip(line, widths, strict=True))
            )
        )
    facts = provenance()
    console.print_line(
        f"rcdn {facts['rcdn']} at {facts['commit']}, {facts['date']}, {facts['platform']}, {facts['cpus']} CPUs"
    )
    if json is not None:
        save(json, suite, settings, rows)
