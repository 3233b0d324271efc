"""`rcdn evaluate patterns`: false boards on stripes, meshes and dots."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, Workers, bar, check_files, show


def patterns(
    count: Annotated[int, typer.Option(min=1, help="Pictures of each pattern, alone and behind a board.")] = 50,
    workers: Workers = 0,
    json: Json = None,
) -> None:
    """False boards on rendered patterns that are no boards: stripes, meshes, dots; and a board before each of them.

    `alone`: pictures of a pattern, in how many of which a false board was found, and in how many it was told that they
    show none (circles, a mesh). `behind a board`: pictures with a 9×6 board before the pattern, in how many of which it
    is whole, the corners of it that are over 1.5 px off, and false boards beside it. At 50 pictures a pattern some five
    minutes of one core.
    """
    from rcdn_lab import patterns as suite

    check_files(json)
    with bar("patterns") as step:
        rows = suite.table(count, workers or os.cpu_count() or 1, step)
    show(rows, json, "patterns", suite.settings_of(count))
