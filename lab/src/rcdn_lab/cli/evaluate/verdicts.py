"""`rcdn evaluate verdicts`: whether the verdict distinguishes good sets of pictures from bad ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.terminal import console
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show

if TYPE_CHECKING:
    from rcdn.types import Board
    from rcdn_lab.verdicts import Outcome


def verdicts(
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA", help="The folder that holds the public sets' folders: judges these photographs, too."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulations.")] = 0,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
) -> None:
    """Does the verdict tell bad sets of pictures from good ones, and does its first line say what is wrong?

    Simulated sets, each with a known fault (two cameras, autofocus, paper, frontal views, copies, wrong sizes, …), and
    good ones of several lenses. `passed`: a bad set is called unsure or bad, or gives no camera; a good one good or
    fair; photographs that people calibrate with anything but bad. `named`: the first line gives the fault, not only a
    symptom. About three minutes on one core.
    """
    from rcdn_lab import verdicts as suite

    check_files(json)
    with bar("judging") as step:
        found = list(suite.table(seed, step))
    if data is not None:
        found += _real(data, cache)
    show([suite.row(o) for o in found], json, "verdicts", {"seed": seed})
    odd = [o.case for o in found if not o.passed]
    console.print_line(f"{len(found) - len(odd)} of {len(found)} passed{': not ' if odd else ''}{', '.join(odd)}")


def _real(data: Path, cache: Path | None) -> Iterator[Outcome]:
    """The public sets, one by one, and mixed pictures of two cameras."""
    from rcdn_lab import verdicts as suite

    boards = {name: _boards(data, name, cache) for name in dict.fromkeys([*suite.REAL, *sum(suite.MIXED, ())])}
    for name in suite.REAL:
        yield suite.real_outcome(name, *boards[name])
    for a, b in suite.MIXED:
        both = boards[a][0] + boards[b][0], boards[a][1] + boards[b][1]
        yield suite.real_outcome(f"{a} and {b}", *both, expected="bad")


def _boards(data: Path, name: str, cache: Path | None) -> tuple[list[Board], list[str]]:
    """All boards of a public set, and the names of their pictures."""
    from rcdn.batch.cache import open_cache
    from rcdn.batch.inputs import gather
    from rcdn.config import DetectorConfig
    from rcdn_lab.calibration.sets import chosen

    (one,) = chosen([name])
    config = DetectorConfig()
    got = gather([str(p) for p in one.files(data)], config, cache=open_cache(config, cache))
    return [b for i in got.images for b in i.boards], [i.path for i in got.images for _ in i.boards]
