"""`rcdn evaluate coded-cameras`: cameras from ChArUco boards, ours and OpenCV's, on held-out pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcdn.terminal import console
from rcdn.terminal.spacing import Length, parse_length
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show

LIMIT = 0.7
"""the goal, × OpenCV's held-out RMS"""
Spacing = Annotated[
    Length,
    typer.Option(
        parser=parse_length,
        metavar="LENGTH",
        help="Side of one square (or triangle), with its unit: 25mm, 2.5cm, 1in. A number alone is in metres: 0.025.",
    ),
]


def coded_cameras(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDERS...", help="Each with the pictures of one camera and one ChArUco board."),
    ],
    spacing: Spacing,
    seeds: Annotated[int, typer.Option(min=1, help="Random halves of each folder.")] = 5,
    json: Json = None,
) -> None:
    """Cameras from ChArUco boards: ours, told the spacing alone, beside OpenCV's detector and
    solver, told the board, too.

    Both calibrate from random halves, each from its own corners. In the pictures of the other half the pose is solved
    from every second corner, and the residuals of the rest count: RMS = √(Σ |observed − projected|² / N), px, over all
    corners that both found. The goal is a ratio of at most 0.7.
    """
    from rcdn_lab import coded_cameras as suite

    check_files(json)
    rows = []
    for folder in folders:
        with bar(folder.name) as step:
            shots = suite.shots_of(suite.pictures_of(folder), step)
        rows.append({"set": folder.name, **suite.compared(shots, float(spacing), seeds)})
    show(rows, json, "coded-cameras", {"spacing": float(spacing), "seeds": seeds})
    reached = sum(row["ratio"] <= LIMIT for row in rows)
    console.print_line(f"held out at most {LIMIT} × OpenCV's in {reached} of {len(rows)} sets")
