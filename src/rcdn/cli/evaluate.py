"""`rcdn evaluate`: the figures of the docs, each by one command."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

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


def _show(rows: list[dict[str, Any]], json: Path | None, suite: str, settings: dict[str, Any]) -> None:
    """Print a table, and save it if wanted."""
    from rcdn.evaluation.results import save
    from rcdn.provenance import provenance

    columns = list(rows[0])
    cells = [
        columns,
        *[[f"{row[c]:.4f}" if isinstance(row[c], float) else str(row[c]) for c in columns] for row in rows],
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
