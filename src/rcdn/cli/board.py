"""`rcdn board`: a checkerboard, or a deltille, to print at true scale."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rcdn.cli._options import GridSize, PatternName, parse_size
from rcdn.cli._spacing import Spacing, check_length
from rcdn.errors import ConfigError

MOST_CORNERS = 1_000_000


class Paper(StrEnum):
    """Sheet sizes; rcdn.report.target knows their millimetres."""

    a0 = "a0"
    a1 = "a1"
    a2 = "a2"
    a3 = "a3"
    a4 = "a4"
    a5 = "a5"
    letter = "letter"
    legal = "legal"
    tabloid = "tabloid"


def board(
    size: Annotated[
        GridSize,
        typer.Option(
            parser=parse_size,
            metavar="COLSxROWS",
            help="Inner corners, where four squares (six triangles) meet: 9x6 gives 10x7 squares.",
        ),
    ],
    spacing: Spacing,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where to write: a .pdf or .svg file.")
    ],
    paper: Annotated[
        Paper, typer.Option(help="Paper size. It is turned if the board fits better that way.")
    ] = Paper.a4,
    pattern: Annotated[
        PatternName, typer.Option(help="checker: squares. deltille: triangles, for `rcdn detect --pattern deltille`.")
    ] = PatternName.checker,
) -> None:
    """Write a checkerboard, or a deltille, to print, as PDF or SVG, at true scale.

    Print it at 100 % ("actual size"), measure the ruler at its foot, and glue it on something flat. Take one odd and
    one even number (9x6, not 8x6): then the board looks different when it is turned by half, and it is always known
    which corner is the first.
    """
    ending = output.suffix.lower()
    if ending not in (".pdf", ".svg"):
        raise ConfigError(f"--output {output}: the name must end in .pdf or .svg")
    if size.cols * size.rows > MOST_CORNERS:
        raise ConfigError(
            f"--size: a board of {size.cols}x{size.rows} can't be printed; {MOST_CORNERS} corners are the most"
        )
    check_length(spacing, size)
    from rcdn.io import write_bytes, write_text
    from rcdn.report.target import make_target, orientation_note, to_pdf, to_svg

    target = make_target(size, spacing, paper.value, pattern.value)
    if ending == ".pdf":
        write_bytes(output, to_pdf(target))
    else:
        write_text(output, to_svg(target))
    lies = "landscape" if target.page[0] > target.page[1] else "portrait"
    millimetres = f"{spacing * 1000:.6g} mm {'squares' if pattern is PatternName.checker else 'triangles'}"
    typer.echo(f"wrote {output}: {size[0]}×{size[1]} inner corners, {millimetres}, {paper.value} {lies}")
    typer.echo("Print it at 100 % and measure the ruler: it must be 100 mm long.")
    if pattern is PatternName.checker and (note := orientation_note(size)):
        typer.echo(f"note: {note}")
