"""What a verb says: its results on standard output, or on standard error where that is for JSON, and nothing where it is to be quiet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

STDOUT = Path("-")
"""as `rcdn.io.STDOUT`, which takes long to import"""

Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="Say nothing but errors and warnings: the files, or --json -, hold the results."
    ),
]


@dataclass
class _Voice:
    """How this run speaks; a new one begins with each command."""

    quiet: bool = False
    piped: bool = False


_voice = _Voice()


def begin(quiet: bool = False, outputs: Iterable[Path | None] = ()) -> None:
    """Set how this run speaks, by the files that it is to write."""
    _voice.quiet, _voice.piped = quiet, STDOUT in outputs


def is_quiet() -> bool:
    """Whether nothing is to be said but errors and warnings."""
    return _voice.quiet


def say(text: str) -> None:
    """A line of the results."""
    if not _voice.quiet:
        typer.echo(text, err=_voice.piped)


def note(text: str) -> None:
    """A line on stderr that is no error."""
    if not _voice.quiet:
        typer.echo(text, err=True)


def named(paths: Iterable[Path]) -> list[str]:
    """The files among `paths` that were written, by their names: who reads standard output knows that."""
    return [str(path) for path in paths if path != STDOUT]


def say_written(paths: Iterable[Path]) -> None:
    """Say which files were written."""
    if names := named(paths):
        note(f"written: {', '.join(names)}")
