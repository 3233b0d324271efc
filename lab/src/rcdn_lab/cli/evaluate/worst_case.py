"""`rcdn evaluate worst-case`: the longest detection times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def worst_case(
    photographs: Annotated[
        Path,
        typer.Argument(metavar="PHOTOGRAPHS", help="A folder; the median of up to 100 of its pictures is the measure."),
    ],
    picture: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="Only pictures whose name contains this; may be given again."),
    ] = None,
    limit: Annotated[float, typer.Option(min=1, help="Seconds of computing after which a picture is given up.")] = 60.0,
    json: Json = None,
) -> None:
    """CPU time a megapixel of pictures made to cost much, beside the median of photographs.

    Tiny squares, hundreds of boards, bent, torn and nested ones; noise, dots, waves, lines, text; odd sizes. One
    thread, each picture in a process of its own. `ratio`: to the median of the photographs, the worst first; pictures
    under 0.1 megapixel count as 0.1. All take some 15 minutes.
    """
    from rcdn_lab.worst_case import run as suite

    check_files(json)
    with bar("measuring") as step:
        rows = suite.table(photographs, picture or (), limit, step)
    show(rows, json, "worst-case", suite.settings_of(photographs, limit))
