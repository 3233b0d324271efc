"""`rcdn evaluate rigs`: simulated rigs of cameras, their places against the truth."""

from __future__ import annotations

from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def rigs(
    seeds: Annotated[
        int, typer.Option(min=1, help="Draws of boards of each rig; an eighth of that of 8 cameras and more.")
    ] = 8,
    large: Annotated[
        bool, typer.Option("--large", help="One rig alone, of 16 cameras and 512 moments: what it takes.")
    ] = False,
    json: Json = None,
) -> None:
    """Simulated rigs: how many of the numbers of the cameras' places lie within one and three of
    their standard deviations.

    Corners have a noise of 0.2 px; each rig is solved from the boards alone, with its cameras' lens models named.
    Six numbers for each two cameras.
    """
    from rcdn_lab import rigs as suite

    check_files(json)
    rows = []
    for name, trial in suite.trials(large).items():
        with bar(name):
            rows.append(suite.rows_of(name, trial, seeds))
    show(rows, json, "rigs-large" if large else "rigs", {"seeds": seeds})
