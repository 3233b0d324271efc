"""`rcdn evaluate guided`: simulated people who hold a board according to the guide, and others."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, Workers, bar, check_files, show


def guided(
    runs: Annotated[int, typer.Option(min=1, help="People of each kind.")] = 6,
    most: Annotated[int, typer.Option(min=10, help="Pictures that each takes.")] = 50,
    workers: Workers = 0,
    kept: Annotated[
        Path | None,
        typer.Option(
            "--kept", metavar="FILE", help="Keep each person's errors in this file; what it holds isn't computed again."
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Simulated people: after how many pictures a camera is right to 0.1 and 0.3 px in the corners of the frame.

    `guided` follow the guide of `rcdn live`, roughly; `random` hold the board as people do, 0.3 to 0.8 m away;
    `coverage`, of such poses, take those that cover the sensor; `expert` go anywhere up to the rim, as near as the
    guide wants it, well tilted. Corners have a noise of 0.1 px; `bent` boards are uneven and solved for. Also: errors
    after ten pictures, px, and the stated deviation ÷ the true error of the guided.
    """
    from rcdn.io import check_writable
    from rcdn_lab import guided as suite

    check_files(json)
    if kept is not None:
        check_writable(kept)
    store = None if kept is None else suite.Kept(kept, suite.code_digest())
    with bar("people") as step:
        rows = suite.rows_of(runs, most, workers or os.cpu_count() or 1, step, store)
    show(rows, json, "guided", {"runs": runs, "most": most})
