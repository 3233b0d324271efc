"""Output of a verb's results: on standard output, or on standard error if a file goes there; none if quiet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

STDOUT = Path("-")
"""equal to `rcdn.io.STDOUT`, which is slow to import"""

Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="Say nothing but errors and warnings: the files, or --json -, hold the results."
    ),
]


@dataclass
class _Output:
    """Output settings of this run; reset at the start of each command."""

    quiet: bool = False
    piped: bool = False


_output = _Output()


def begin(quiet: bool = False, outputs: Iterable[Path | None] = ()) -> None:
    """Set the output of this run; `outputs`: the files that it will write, STDOUT among them if one goes there."""
    _output.quiet, _output.piped = quiet, STDOUT in outputs


def is_quiet() -> bool:
    """Whether only errors and warnings are printed."""
    return _output.quiet


def print_line(text: str) -> None:
    """Print a line of the results."""
    if not _output.quiet:
        typer.echo(text, err=_output.piped)


def note(text: str) -> None:
    """Print a line on stderr that is not an error."""
    if not _output.quiet:
        typer.echo(text, err=True)


def named(paths: Iterable[Path]) -> list[str]:
    """Names of the files among `paths`; standard output is omitted, since its reader knows of it."""
    return [str(path) for path in paths if path != STDOUT]


def note_written(paths: Iterable[Path]) -> None:
    """Print the names of the written files."""
    if names := named(paths):
        note(f"written: {', '.join(names)}")
