"""The contract of every target: a valid result or RcdnError; nothing printed, no warning, no end of the process,
bounded time and memory."""

from __future__ import annotations

import os
import re
import resource
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tests.fuzz.source import Source
from tests.fuzz.target import BrokenPromise, Target, scratch

from rcdn.errors import RcdnError

DECODERS = re.compile(
    r"(libpng (error|warning)|Corrupt JPEG data|Premature end of JPEG|"
    r"Warning: unknown JFIF revision|Invalid SOS parameters)"
)
"""lines of decoders, which only a process as a whole can silence: the commands do"""
SLOW = 5.0
"""s of the processor that an input may take"""
MEMORY = 6 << 30
"""bytes that a process may map; what asks for more gets a MemoryError"""


@dataclass(frozen=True)
class Failure:
    """A broken contract: `kind` of it (an exception's name, `printed`, `slow`),
    `where` in the code, and what was said."""

    kind: str
    where: str
    said: str

    @property
    def key(self) -> str:
        """The same for the same failure of other inputs."""
        return f"{self.kind} at {self.where}"


@dataclass
class Tally:
    """What became of the inputs."""

    inputs: int = 0
    refused: int = 0
    slowest: float = 0.0
    slowest_data: bytes = b""
    failures: dict[str, int] = field(default_factory=dict)


class Guard:
    """Runs inputs of a target and judges what becomes of them."""

    def __init__(self, target: Target, printed: Path | None = None) -> None:
        self.target, self.tally, self._printed = target, Tally(), printed
        self._read = 0

    def run(self, data: bytes) -> Failure | None:
        """Make an input of `data` and check it."""
        self._read = self._size()
        began = time.process_time()
        failure = self._outcome(data)
        taken = time.process_time() - began
        tally = self.tally
        tally.inputs += 1
        if taken > tally.slowest:
            tally.slowest, tally.slowest_data = taken, data
        failure = (
            failure or self._output() or (Failure("slow", self.target.name, f"{taken:.1f} s") if taken > SLOW else None)
        )
        if failure:
            tally.failures[failure.key] = tally.failures.get(failure.key, 0) + 1
        return failure

    def _outcome(self, data: bytes) -> Failure | None:
        try:
            with np.errstate(all="ignore"):  # absurd numbers are made of absurd numbers
                given = self.target.make(Source(data))
        except Exception as error:
            return failure_of(error, "making an input: ")
        return self.check(given)

    def check(self, given: Any) -> Failure | None:
        """Check an input."""
        try:
            self.target.check(given)
        except RcdnError as error:
            self.tally.refused += 1
            return (
                None
                if _one_line(error)
                else Failure("message of several lines", type(error).__name__, str(error)[:300])
            )
        except Exception as error:
            return failure_of(error)
        return None

    def _output(self) -> Failure | None:
        """What was printed during this input."""
        if self._printed is None or self._size() == self._read:
            return None
        with self._printed.open("rb") as file:
            file.seek(self._read)
            said = file.read(2000).decode(errors="replace")
        lines = [line for line in said.splitlines() if line and not DECODERS.match(line)]
        return Failure("printed", _words(lines[0]), said) if lines else None

    def _size(self) -> int:
        return self._printed.stat().st_size if self._printed else 0


def _words(said: str) -> str:
    """What is printed, without its numbers, so that the same message counts as the same."""
    return " ".join("".join(c if c.isalpha() else " " for c in said).split()[:8])


def _one_line(error: Exception) -> bool:
    return "\n" not in str(error) and len(str(error)) < 5000


def failure_of(error: Exception, before: str = "") -> Failure:
    """Where an exception was raised: the deepest frame of rcdn; of a BrokenPromise, what was promised."""
    said = "".join(traceback.format_exception_only(error)).strip()[:600]
    if isinstance(error, BrokenPromise):
        return Failure("BrokenPromise", before + _words(str(error)), said)
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if f"{os.sep}rcdn{os.sep}" in f.filename] or list(frames)
    place = ours[-1]
    return Failure(
        type(error).__name__, f"{before}{'/'.join(Path(place.filename).parts[-3:])}:{place.lineno} {place.name}", said
    )


@contextmanager
def strict() -> Iterator[Path]:
    """Warnings are errors, and what is printed goes to the file that is given."""
    path = scratch() / "printed"
    with warnings.catch_warnings(), path.open("w", buffering=1) as file, redirect_stdout(file), redirect_stderr(file):
        warnings.simplefilter("error")
        saved = os.dup(1), os.dup(2)
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            yield path
        finally:
            os.dup2(saved[0], 1)
            os.dup2(saved[1], 2)


def bound_memory() -> None:
    """What asks for too much gets a MemoryError, not the machine's."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def peak_memory() -> int:
    """Bytes that this process has held in memory at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
