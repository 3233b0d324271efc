"""Output of a verb's results: on standard output, or on standard error if a file goes there; none if quiet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
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
    """Output settings of this run, and the errors and warnings of files that it `printed`; reset at the start of each
    command."""

    quiet: bool = False
    piped: bool = False
    printed: set[str] = field(default_factory=set)


_output = _Output()


def begin(quiet: bool = False, outputs: Iterable[Path | None] = ()) -> None:
    """Set the output of this run; `outputs`: the files that it will write, STDOUT among them if one goes there."""
    _output.quiet, _output.piped, _output.printed = quiet, STDOUT in outputs, set()


def is_quiet() -> bool:
    """Whether only errors and warnings are printed."""
    return _output.quiet


def first_time(message: str) -> bool:
    """Whether this is the first time that this run prints the `message`: a video that is read twice has its errors and
    warnings twice."""
    known = message in _output.printed
    _output.printed.add(message)
    return not known


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
