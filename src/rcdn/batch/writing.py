"""Writing several files: each error is reported on a line of its own, and the other files are written."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from rcdn.batch.work import explain
from rcdn.errors import OutputError, RcdnError
from rcdn.terminal.group import print_error


def write_each(tasks: Iterable[tuple[Path | None, Callable[[Path], object]]]) -> list[Path]:
    """Call each function with its path, unless that is None, and return the paths that were written. An error of one
    function doesn't stop the others."""
    written = []
    for path, write in tasks:
        if path is None:
            continue
        try:
            write(path)
        except OutputError as error:  # its message names the file
            print_error(str(error))
        except RcdnError as error:
            print_unwritten(path, str(error))
        except Exception as error:
            print_error(explain(error, f"{path} is not written"))
        else:
            written.append(path)
    return written


def print_unwritten(path: Path, reason: str) -> None:
    """Report that this file is not written, and the reason."""
    print_error(f"{path} is not written: {reason}")
