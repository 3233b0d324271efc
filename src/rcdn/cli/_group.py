"""How errors look: one red line on stderr and an exit code, never a traceback for what rcdn raises on purpose."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

from rcdn import interrupts
from rcdn.errors import ConfigError, RcdnError

FAILED, WRONG_USE, INTERRUPTED = 1, 2, 130


def say_error(message: str) -> None:
    """One line `error: …` on stderr, red on a terminal."""
    typer.secho(f"error: {one_line(message)}", fg="red", err=True)


def say_stopped(rest: str = "") -> None:
    """The last line after Ctrl-C, which no second Ctrl-C disturbs."""
    interrupts.end()
    say_error(f"stopped by Ctrl-C{rest}")


def say_warning(message: str) -> None:
    """One line `warning: …` on stderr, yellow on a terminal."""
    typer.secho(f"warning: {one_line(message)}", fg="yellow", err=True)


def one_line(text: str) -> str:
    """`text` without what would break a line or the terminal: a file's name may hold anything."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


class Group(TyperGroup):
    """The root of the verbs; errors of all of them, however deep, arrive here."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except ConfigError as error:
            say_error(str(error))
            raise typer.Exit(WRONG_USE) from None
        except RcdnError as error:
            say_error(str(error))
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt:
            say_stopped()
            raise typer.Exit(INTERRUPTED) from None
