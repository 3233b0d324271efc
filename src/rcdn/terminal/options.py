"""Command-line options shared by several verbs."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import typer


class PatternName(StrEnum):
    """Pattern of boards: values of `rcdn.types.Pattern`."""

    checker = "checker"
    deltille = "deltille"


Pattern = Annotated[
    PatternName,
    typer.Option(
        help="What the boards are made of. checker: squares. deltille: triangles, six of which meet in a corner."
    ),
]


class GridSize(NamedTuple):
    """(columns, rows) of inner corners, or (width, height) of a picture, px. A class, because Typer would parse a plain
    tuple from two arguments."""

    cols: int
    rows: int


def two_numbers(text: str, digits: int) -> GridSize | None:
    """`9x6` (also `9X6`, `9×6`), numbers of at most so many `digits`; None for anything else."""
    match = re.fullmatch(rf"\s*(\d{{1,{digits}}})\s*[xX×]\s*(\d{{1,{digits}}})\s*", text)
    return GridSize(int(match[1]), int(match[2])) if match else None


def parse_size(text: str, least: int = 3) -> GridSize:
    """`9x6` (also `9X6`, `9×6`) as columns and rows, both at least `least`. Raises typer.BadParameter."""
    size = two_numbers(text, 4)
    if size is None:
        raise typer.BadParameter(f"{text!r} is not a size; give columns x rows of inner corners, such as 9x6")
    if min(size) < least:
        raise typer.BadParameter(f"{text!r} is too small; a board has at least {least}x{least} inner corners")
    return size


def parse_folder(text: str) -> Path:
    """The path of a folder to write to. Raises typer.BadParameter for `-`, standard output."""
    if text == "-":
        raise typer.BadParameter("several files are written, which needs a folder; name one (./- for one called -)")
    return Path(text)


def camera_formats() -> list[str]:
    """The formats of camera files."""
    from rcdn.io.cameras import names_of

    return [*names_of()]


def parse_camera_format(text: str) -> str:
    """One of the `camera_formats`. Raises typer.BadParameter."""
    return one_of(text, camera_formats())


def one_of(text: str, known: Sequence[str]) -> str:
    """`text`, if it is one of the words that are `known`. Raises typer.BadParameter."""
    if text not in known:
        raise typer.BadParameter(f"{text!r} is none of {', '.join(known)}")
    return text


Jobs = Annotated[
    int,
    typer.Option("--jobs", "-j", min=0, metavar="N", help="Processes that find corners; 0: one for each core."),
]
CacheFolder = Annotated[
    Path | None,
    typer.Option(
        "--cache", metavar="DIR", help="Where detections are kept for the next run, instead of the usual place."
    ),
]
NoCache = Annotated[bool, typer.Option("--no-cache", help="Neither use detections of earlier runs nor keep these.")]


def _allow(megapixels: float | None) -> float | None:
    """Set the largest picture that this process and its child processes read; None: by the environment variable."""
    from rcdn.limits import VARIABLE, max_megapixels, set_max_megapixels

    if megapixels is not None or os.environ.get(VARIABLE):
        set_max_megapixels(max_megapixels() if megapixels is None else megapixels)
    return megapixels


MaxMegapixels = Annotated[
    float | None,
    typer.Option(
        "--max-megapixels",
        min=0.001,
        max=1e6,
        metavar="N",
        callback=_allow,
        help="The largest picture or frame that is read; without it 250, "
        "or the environment variable RCDN_MAX_MEGAPIXELS.",
    ),
]
PicturePlaces = Annotated[
    list[Path] | None,
    typer.Option(
        "--pictures",
        metavar="PLACE",
        help="A folder or file whose photographs a saved file may name for the report; those that were moved are found "
        "in it by the last parts of their paths. May be given several times. Without it only those in the saved "
        "file's own folder are shown.",
    ),
]
Frames = Annotated[
    int,
    typer.Option("--frames", min=1, metavar="N", help="Frames to use of each video, at most: sharp, different ones."),
]
