"""What is fuzzed: how an input is made, and what must hold of it."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.fuzz.source import Source


@dataclass(frozen=True)
class Target:
    """`make` an input from choices; `check` that the software gives a valid result for it, or raises RcdnError.

    Where the input is a file, it is bytes, and its name ends in `suffix`. `share`: of a campaign's time, relative to
    the others'. `guided`: code in Python decides, which an engine can follow. `tries`: inputs in a run of the tests.
    """

    name: str
    make: Callable[[Source], Any]
    check: Callable[[Any], None]
    suffix: str = ""
    share: float = 1.0
    guided: bool = False
    tries: int = 40


class BrokenPromise(AssertionError):
    """A result that isn't valid."""


def must(holds: Any, what: str) -> None:
    """Raise BrokenPromise unless it holds (an assert that can't be switched off, and costs no line of pytest's)."""
    if not holds:
        raise BrokenPromise(what)


def scratch_of(process: int) -> Path:
    """The folder of a process for its files, in memory if there is such a disk."""
    memory = "/dev/shm"
    return Path(memory if os.access(memory, os.W_OK) else tempfile.gettempdir()) / f"rcdn-fuzz-{process}"


@cache
def scratch() -> Path:
    """The folder of this process, empty at first."""
    folder = scratch_of(os.getpid())
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def as_file(data: bytes, suffix: str, name: str = "input") -> Path:
    """A file that holds `data`, until the next of that name."""
    path = scratch() / f"{name}{suffix}"
    path.write_bytes(data)
    return path
