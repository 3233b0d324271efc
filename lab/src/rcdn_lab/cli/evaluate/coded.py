"""`rcdn evaluate coded`: corner ids on ChArUco boards, AprilGrids and PuzzleBoards."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def coded(
    data: Annotated[
        Path | None,
        typer.Argument(
            metavar="DATA", help="A folder with truth.json, the labelled pictures, and videos beside a charuco.toml."
        ),
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(help="real, degraded, videos, rendered or 'no codes' (all, if not given); may be given again."),
    ] = None,
    without: Annotated[
        list[Path] | None,
        typer.Option(metavar="FOLDER", help="Pictures without codes, for the part 'no codes'; may be given again."),
    ] = None,
    skip: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A folder or file below FOLDER to leave out; may be given again."),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Rendered pictures of a kind under a condition.")] = 5,
    kind: Annotated[
        list[str] | None, typer.Option(help="Rendered boards whose kind begins so; may be given again.")
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option(help="Conditions of rendered boards; may be given again.")
    ] = None,
    scenes: Annotated[int, typer.Option(min=0, help="Rendered scenes without codes.")] = 1000,
    peers: Annotated[
        str, typer.Option(metavar="auto|none|NAME,…", help="Other readers to run on the same pictures; auto: all.")
    ] = "auto",
    workers: Annotated[int, typer.Option("--workers", "-j", min=0, help="Processes; 0: one a core.")] = 0,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also write the rendered boards to this folder, as PNG.")
    ] = None,
    json: Json = None,
) -> None:
    """Numbers on boards that carry codes: ours, told nothing, beside readers that are told everything.

    real: labelled photographs; degraded: the same halved, blurred (2 px), with noise (20 grey levels), at a fifth of
    the light; videos: frames that are read, and numbers that readers see at different places; rendered: kinds of boards
    under conditions, at VGA, the recall of each; 'no codes': no board may have a number. A number is right within 4 px
    of its corner. `named`: boards whose kind, dictionary and legacy are right. The lines at the end say which goals are
    reached. All takes some ten minutes of two cores.
    """
    from rcdn.io.files import is_stream
    from rcdn_lab import coded as suite
    from rcdn_lab.results import save

    check_files(json)
    names, lacking = suite.contestants([name.strip() for name in peers.split(",") if name.strip()])
    plan = suite.Plan(
        data, tuple(without or ()), tuple(skip or ()), count, tuple(kind or ()), tuple(condition or ()), scenes,
        tuple(names), workers or os.cpu_count() or 1, pictures,
    )  # fmt: skip
    rows: list[dict[str, Any]] = []
    done: list[str] = []
    wanted = suite.parts_of(part or (), plan)
    for name in wanted:
        with bar(name) as step:
            own = suite.table(name, plan, step)
        rows += own
        done.append(name)
        if own:
            show(suite.shown(name, own), None, "coded", {})
        last = name == wanted[-1]
        if json is not None and (last or not is_stream(json)):  # after each part, so that nothing measured is lost
            goals = [suite.record(goal) for goal in suite.goals(rows)]
            save(json, "coded", suite.settings_of(plan, done) | {"skipped": lacking, "goals": goals}, rows)
    for goal in suite.goals(rows):
        console.print_line(str(goal))
    for peer, reason in lacking.items():
        console.print_line(f"skipped {peer}: {one_line(reason)}")
