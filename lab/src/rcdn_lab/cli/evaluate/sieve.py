"""`rcdn evaluate sieve`: corners lost by the sieve before the network."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, Workers, bar, check_files, show


def sieve(
    count: Annotated[int, typer.Option(min=1, help="Pictures a level.")] = 5,
    factor: Annotated[
        list[str] | None, typer.Option(help="noise, blur, tilt, … (all, if not given); may be given again.")
    ] = None,
    workers: Workers = 0,
    json: Json = None,
) -> None:
    """Recall of the sieve that says where the network is evaluated, on the pictures of `rcdn evaluate sweep`.

    The network is evaluated everywhere, in all views of the whole picture that detection looks at. `recall`: of the
    visible corners to which a peak of that response above the threshold belongs (the nearest one, within 2 px of the
    view), the share whose peak lies in a cell that the sieve marks; `lost`: the others; `recall of peaks`: the same of
    all peaks above the threshold; `share of cells`: those that are marked. A line a factor, with its worst level and
    the recall there; the file of --json has a row a level. At 5 pictures a level some 2 minutes of one core.
    """
    from rcdn_lab import sieve as suite
    from rcdn_lab.results import save

    check_files(json)
    with bar("sieving") as step:
        rows = suite.table(count, factor or (), workers or os.cpu_count() or 1, step)
    show(suite.by_factor(rows), None, "sieve", {})
    if json is not None:
        save(json, "sieve", suite.settings_of(count), rows)
