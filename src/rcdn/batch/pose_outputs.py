"""Outputs of `rcdn pose`, with one camera or a rig: a line for each pose, failures, the JSON and the exit code."""

from __future__ import annotations

import json as json_module
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rcdn.errors import RcdnError
from rcdn.terminal import console
from rcdn.terminal.group import FAILED, print_error
from rcdn.terminal.spacing import Length, Lengths, metres

if TYPE_CHECKING:
    from rcdn.batch.pose_boards import PoseBoards

Solve = Callable[[], tuple[str, dict[str, Any]]]
"""the line and the record of one pose; raises RcdnError if there is none"""


def tell_poses(
    poses: Iterable[tuple[str, Solve]],
    key: str,
    length: Length | Lengths,
    json: Path | None,
    boards: PoseBoards,
) -> None:
    """Print the lines of the `poses`, each solved at its turn and named by its picture or moment, and write their
    records as the list `key` of `json`. Raises typer.Exit if one failed, now or when the inputs of the `boards`
    were read, or if there is none."""
    from rcdn.io import write_text

    records, tried, failed = [], 0, any(got.failures for got in boards.read)
    for name, solve in poses:
        tried += 1
        try:
            line, record = solve()
        except RcdnError as error:
            print_error(f"{name}: {error}")
            failed = True
            continue
        console.print_line(line)
        records.append(record)
    if not tried and (boards.images or not failed):
        print_error(f"no pose: {boards.nothing()}")
    if json is not None:
        lines = ",\n".join(json_module.dumps(r) for r in records)
        write_text(json, f'{{"version": 1, "spacing": {json_module.dumps(metres(length))}, "{key}": [\n{lines}\n]}}\n')
    if failed or not records:
        raise typer.Exit(FAILED)
