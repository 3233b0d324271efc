"""`rcdn evaluate table2`, `table3` and `seeds`: the paper's section 4.1."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn_lab.cli.evaluate._table import Csv, Json, Workers, bar, check_files, show, write_csv

if TYPE_CHECKING:
    from rcdn_lab.paper.tables import Name

Data = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", envvar="RCDN_DATA",
        help="The folder of photographs (rochade-gopro-a, rochade-ueye, truth.json); "
        "without it their rows are skipped.",
    ),
]  # fmt: skip
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", help="mesa-like, ueye-like, ueye, gopro-like or gopro (default: all); may be given again."),
]
Full = Annotated[bool, typer.Option("--full", help="As many pictures as the paper has, or as there are.")]
Count = Annotated[int | None, typer.Option(min=1, help="At most so many pictures a set.")]
CacheDir = Annotated[
    Path | None, typer.Option("--cache", metavar="DIR", help="Where detections are kept, so that a run can go on.")
]
Markdown = Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the section of the docs to this file.")]


def _command(name: Name, text: str) -> Callable[..., None]:
    """The command of a table; `text`: its help."""

    def command(
        data: Data = None,
        sets: Sets = None,
        full: Full = False,
        count: Count = None,
        workers: Workers = 0,
        cache: CacheDir = None,
        json: Json = None,
        csv: Csv = None,
        markdown: Markdown = None,
    ) -> None:
        _run(name, data, sets, full, count, workers, cache, json, csv, markdown)

    command.__doc__ = text
    return command


table2 = _command(
    "table2",
    """The paper's Table 2: thresholds and losses. Net A with cross entropy and with the squared loss (MATE).

    Precision and recall of raw corners at 4 px, beside the paper's, on photographs and on rendered stand-ins: mesa-like
    (206 pictures), ueye-like (24; 206 with --full), gopro-like (10; 100), ueye (5), gopro (30). `precision`, `recall`:
    the paper's reading, in which a second detection of one corner is true as well; `strict`: one to one; `diff`: ours
    less the paper's. About 4 minutes on two cores, half an hour with --full.
    """,
)
table3 = _command(
    "table3",
    """The paper's Table 3: networks A to H, D-3, E-16, MATE, and ChESS, under the adaptive threshold.

    Pictures and columns as in `rcdn evaluate table2`. Then the claims of section 4.1, one by one.
    About 8 minutes on two cores, 45 with --full.
    """,
)
seeds = _command(
    "seeds",
    """Each network of Table 3 from two seeds, all by one budget; F, too, not as it ships.

    Pictures and columns as in `rcdn evaluate table2`. Then the claims about Table 3: where they hold or don't beyond
    the scatter of seeds. About 15 minutes of one core, six times as much with --full.
    """,
)


def _run(
    name: Name, data: Path | None, sets: list[str] | None, full: bool, count: int | None, workers: int,
    cache: Path | None, json: Path | None, csv: Path | None, markdown: Path | None,
) -> None:  # fmt: skip
    from rcdn.io import write_text
    from rcdn.provenance import provenance
    from rcdn_lab.paper import table_text as text
    from rcdn_lab.paper import tables as suite
    from rcdn_lab.results import save

    check_files(json, csv, markdown)
    what = suite.plan(name, data, full, sets or (), count)
    with bar("looking for corners") as step:
        rows = suite.table(what, workers or os.cpu_count() or 1, cache, step)
    settings = suite.settings_of(what) | {"full": full}
    show(text.printed(rows), None, name, settings)
    for row in rows:
        if row["note"]:
            console.print_line(f"{text.name_of(row)} {one_line(row['note'])}")
    for line in text.claim_lines(name, rows):
        console.print_line(line)
    if json is not None:
        save(json, name, settings, rows)
    if csv is not None:
        write_csv(rows, csv)
    if markdown is not None:
        words = [f"--set {s}" for s in sets or ()] + ["--full"] * full + [f"--count {count}"] * (count is not None)
        command = " ".join([f"rcdn evaluate {name}", *words])
        write_text(markdown, text.markdown(name, rows, provenance(), settings, command))
