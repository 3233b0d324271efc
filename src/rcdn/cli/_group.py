"""How errors look: one red line on stderr and an exit code, never a traceback for what rcdn raises on purpose."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

from rcdn import interrupts
from rcdn.cli import _talk
from rcdn.errors import ConfigError, RcdnError
from rcdn.errors import many as many  # what verbs say

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

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The verbs by their groups, in the order in which they were added; those without a group first."""
        groups: dict[str, list[tuple[str, str]]] = {"Commands": []}
        verbs = {name: verb for name in self.list_commands(ctx) if (verb := self.get_command(ctx, name)) is not None}
        wide = max(map(len, verbs))
        for name, verb in verbs.items():
            group = getattr(verb, "rich_help_panel", None)
            line = verb.get_short_help_str(formatter.width - wide - 6)
            groups.setdefault(group if isinstance(group, str) else "Commands", []).append((f"{name:<{wide}}", line))
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        _talk.begin()
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ")  # Pydantic's words, in Typer from 0.29
            raise
        except ConfigError as error:
            say_error(str(error))
            raise typer.Exit(WRONG_USE) from None
        except RcdnError as error:
            say_error(str(error))
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt:
            say_stopped()
            raise typer.Exit(INTERRUPTED) from None
