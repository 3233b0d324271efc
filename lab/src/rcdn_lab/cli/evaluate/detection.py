"""`rcdn evaluate scenes`, `hard`, `detections` and `recovery`: detection against known truth."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def scenes(
    count: Annotated[int, typer.Option(min=1, help="Rendered 640×480 scenes.")] = 300,
    json: Json = None,
) -> None:
    """Raw corners on rendered scenes: precision and recall at 4 px under each threshold of the paper's
    Table 2 (about 4 minutes)."""
    from rcdn_lab import scenes as suite
    from rcdn_lab.weights import PRESETS, weights_of

    check_files(json)
    rows = suite.table(count, os.cpu_count() or 1)
    settings = {"count": count, "first seed": suite.FIRST, "radius": suite.RADIUS, "size": [640, 480]}
    settings["weights"] = weights_of(PRESETS)
    show(rows, json, "scenes", settings)


def hard(
    model: Annotated[list[str] | None, typer.Option(help="auto, paper, or an .onnx file; may be given again.")] = None,
    json: Json = None,
) -> None:
    """F1 at 2 px on the fixed hard validation crops: noise to 60, blur to 4 px, contrast from 18 grey levels,
    tilt to 75° (a minute)."""
    from rcdn_lab import hard as suite
    from rcdn_lab.weights import weights_of

    check_files(json)
    models = tuple(model or ("auto", "paper"))
    show(suite.table(models), json, "hard", {"models": models, "weights": weights_of(models)})


def detections(
    found: Annotated[Path, typer.Argument(metavar="DETECTIONS.json", help="What `rcdn detect --json` wrote.")],
    truth: Annotated[
        Path, typer.Argument(metavar="TRUTH.json", help="The true corners, as `rcdn render` writes them.")
    ],
    json: Json = None,
) -> None:
    """Score a file of detections against the truth: whole boards, recall, wrong corners and labels, false alarms."""
    from rcdn_lab import detections as suite

    check_files(json)
    show(suite.table(found, truth), json, "detections", {"detections": str(found), "truth": str(truth)})


def recovery(
    count: Annotated[int, typer.Option(min=1, help="Pictures a kind.")] = 6,
    least: Annotated[int, typer.Option(min=4, help="Fewest corners of a board.")] = 9,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also draw both side by side, and the sheet recovery.jpg, into it."),
    ] = None,
    json: Json = None,
) -> None:
    """The paper's board recovery (growth) and ours (graph) on the same corners of the same
    rendered pictures (3 minutes).

    Flat, tilted, distorted, bent, covered and cut boards, several, none. `whole`: boards with all visible corners, no
    other, and right labels; `wrong`: corners of boards that are none; `labels`: boards with a wrong label; `false`:
    boards where none is.
    """
    from rcdn_lab import recovery as suite
    from rcdn_lab.plots.recovery import Gallery
    from rcdn_lab.weights import weights_of

    check_files(json)
    gallery = Gallery()
    with bar("recovering") as step:
        rows = suite.table(count, least, step, gallery.add if pictures is not None else None)
    if pictures is not None:
        gallery.write(pictures)
    settings = {"count": count, "least": least, "first seed": suite.FIRST, "weights": weights_of(suite.PRESETS)}
    show(rows, json, "recovery", settings)
