"""Expanding arguments to files, and checks of the output paths."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from rcdn.batch.work import Failure
from rcdn.errors import ConfigError


def expanded(arguments: Sequence[str]) -> tuple[list[Path], list[Failure]]:
    """The files that `arguments` denote, and a failure, already reported, for each argument that denotes none. Prints
    notes on pictures that are skipped."""
    from rcdn.errors import many
    from rcdn.io import find
    from rcdn.terminal import console
    from rcdn.terminal.group import one_line, print_error

    found = find(arguments)
    for _, message in found.errors:
        print_error(message)
    for paths, what, fix in (
        (found.own, "that rcdn made of others", ""),
        (found.unread, "of formats that aren't read", "; convert them to TIFF or PNG"),
    ):
        if paths:
            first = one_line(str(paths[0]))
            rest = "is skipped: " + first if len(paths) == 1 else f"are skipped: {first}, …"
            console.note(f"note: {many(len(paths), 'picture')} {what} {rest}{fix}")
    return found.files, [Failure(name, message) for name, message in found.errors]


def check_file(option: str, path: Path | None, inputs: Sequence[Path]) -> None:
    """Raise before the computation, not after it, if `path` can't be written or would overwrite an input. Raises
    ConfigError or OutputError."""
    if path is None:
        return
    from rcdn.io import check_writable, is_video
    from rcdn.io.files import PICTURE_ENDINGS

    mine, picture = os.path.abspath(path), is_video(path) or path.suffix.lower() in PICTURE_ENDINGS
    if picture or any(os.path.abspath(p) == mine for p in inputs):
        what = "a picture (did the shell put a pattern's first file there?)" if picture else "an input"
        raise ConfigError(f"{option} {path}: that would overwrite {what}; name the file to write after {option}")
    check_writable(path)


def outside(folder: Path, arguments: Sequence[str], paths: Sequence[Path], option: str = "--overlay") -> list[Path]:
    """The `paths` outside the output `folder` of an `option`: files that an earlier run wrote there are not inputs.

    Raises ConfigError if the user named that folder, or a file in it, as an input.
    """
    mine = Path(os.path.abspath(folder))
    if any(Path(os.path.abspath(a)).is_relative_to(mine) for a in arguments):
        raise ConfigError(f"{option} {folder}: pictures in this folder are inputs, too; choose another folder")
    return [p for p in paths if not Path(os.path.abspath(p)).is_relative_to(mine)]
