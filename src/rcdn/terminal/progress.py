"""A progress bar on a terminal, and no output in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rcdn.terminal.console import is_quiet
from rcdn.terminal.group import one_line, print_error, print_warning


@dataclass(frozen=True)
class Bar:
    """`advance(inputs done, current name)` moves the bar; `print_error(message)` prints an error without corrupting
    the bar, `warn(message)` a warning; `describe(text)` displays the current activity.
    """

    advance: Callable[[int, str], None]
    print_error: Callable[[str], None]
    warn: Callable[[str], None]
    describe: Callable[[str], None]


@contextmanager
def progress(total: int) -> Iterator[Bar]:
    """A progress bar on stderr if that is a terminal; none in a pipe, or with --quiet."""
    if not sys.stderr.isatty() or is_quiet():
        yield Bar(lambda done, name: None, print_error, print_warning, lambda text: None)
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.text import Text

    columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield Bar(
            lambda done, name: bar.update(task, completed=done, description=escape(one_line(Path(name).name))),
            lambda message: bar.console.print(Text(f"error: {one_line(message)}", style="red"), soft_wrap=True),
            lambda message: bar.console.print(Text(f"warning: {one_line(message)}", style="yellow"), soft_wrap=True),
            lambda text: bar.update(task, description=escape(one_line(text))),
        )
