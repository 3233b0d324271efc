"""Command group and error reporting: one red line on stderr and an exit code, no traceback for rcdn's own errors."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from rcdn import interrupts
from rcdn.errors import ConfigError, RcdnError
from rcdn.terminal import console

FAILED, WRONG_USE, INTERRUPTED = 1, 2, 130


def print_error(message: str) -> None:
    """One line `error: …` on stderr, red on a terminal."""
    typer.secho(f"error: {one_line(message)}", fg="red", err=True)


def print_stopped(rest: str = "") -> None:
    """Print the last line after Ctrl-C; a second Ctrl-C doesn't interrupt it."""
    interrupts.end()
    print_error(f"stopped by Ctrl-C{rest}")


def print_warning(message: str) -> None:
    """One line `warning: …` on stderr, yellow on a terminal."""
    typer.secho(f"warning: {one_line(message)}", fg="yellow", err=True)


def one_line(text: str) -> str:
    """`text` without control characters, which could break the line or the terminal: file names may contain any."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


VERBS = "rcdn.verbs"
"""group of entry points through which other packages add verbs, each a Typer app"""
ELSEWHERE = {"evaluate": "rcdn-lab", "bench": "rcdn-lab"}
"""verb → the package that adds it"""
BUILDERS = "To build and measure rcdn"
"""the last group of the help"""


class Group(TyperGroup):
    """The root command with all verbs, including those of other packages; all their errors are handled here."""

    def list_commands(self, ctx: Any) -> list[str]:
        """rcdn's verbs in the order in which they were added, then those of other packages."""
        from importlib.metadata import entry_points

        return [*super().list_commands(ctx), *sorted(entry_points(group=VERBS).names, reverse=True)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The verb `cmd_name` of any package. Raises ConfigError for a verb whose package isn't installed."""
        from importlib.metadata import entry_points

        verb = super().get_command(ctx, cmd_name)
        if verb is not None:
            return verb
        for entry in entry_points(group=VERBS, name=cmd_name):
            verb = get_command(entry.load())
            verb.name = cmd_name
            if not isinstance(getattr(verb, "rich_help_panel", None), str):
                verb.rich_help_panel = BUILDERS  # type: ignore[attr-defined]  # as Typer sets for its own
            return verb
        if cmd_name in ELSEWHERE:
            raise ConfigError(f"rcdn {cmd_name} is in another package: pip install {ELSEWHERE[cmd_name]}")
        return None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs by group, in the order in which they were added; those without a group first."""
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
        console.begin()
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ")  # added by Pydantic, in Typer from 0.29
            raise
        except ConfigError as error:
            print_error(str(error))
            raise typer.Exit(WRONG_USE) from None
        except RcdnError as error:
            print_error(str(error))
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt:
            print_stopped()
            raise typer.Exit(INTERRUPTED) from None
