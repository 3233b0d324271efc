"""Runs each detector in a process of its own, so that its threads, memory and crashes do not affect the figures of the
others."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from rcdn.errors import RcdnError
from rcdn.types import Array
from rcdn_lab.bench.resident import resident
from rcdn_lab.peers import Find, Grid, quiet

Size = tuple[int, int]
LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")
START = 120.0
"""s, time limit for constructing a detector"""
PATIENCE = 180.0
"""s, time limit for one picture, after which the process is ended"""


class Broken(RcdnError):
    """A detector that failed or crashed on a picture, or exceeded the time limit."""


@dataclass(frozen=True)
class Timing:
    """One picture: wall-clock `seconds`, `cpu` seconds of all processors, number of `corners` found, in `grids`."""

    seconds: float
    cpu: float
    corners: int
    grids: tuple[Grid, ...] = ()


@dataclass(frozen=True)
class Memory:
    """MB: resident memory after loading (`before`), and its maximum so far (`peak`)."""

    before: float
    peak: float


@contextmanager
def limited(threads: int) -> Iterator[None]:
    """Set the number of threads in the environment of processes started in this context."""
    kept = {name: os.environ.get(name) for name in LIMITS}
    os.environ.update(dict.fromkeys(LIMITS, str(threads)))
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Child:
    """A detector in its own process, on `threads` cores at most.

    `load` makes the detector there: a function that can be imported by its name, or a partial of one. The process is
    started at the first use, and again after a crash. Use it as a context manager, or call `close`.
    """

    def __init__(self, load: Callable[[], Find], threads: int) -> None:
        self._load = load
        self._threads = threads
        self._process: Any = None
        self._pipe: Any = None

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def time(self, image: Array, size: Size) -> Timing:
        """Detect in `image` (H, W) uint8 once. Raises Broken."""
        answer = self._request((image, size), PATIENCE)
        if not isinstance(answer, Timing):
            raise Broken(f"an answer of type {type(answer).__name__}")
        return answer

    def memory(self) -> Memory | None:
        """Present and maximum memory; None if the operating system does not report them. Raises Broken."""
        answer: Memory | None = self._request(None, PATIENCE)
        return answer

    def close(self) -> None:
        """End the process, if it runs."""
        if self._process is None:
            return
        self._pipe.close()
        self._process.join(3)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self._process.close()
        self._process = None

    def _start(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._load, self._threads), daemon=True)
        with limited(self._threads):
            self._process.start()
        theirs.close()
        try:
            self._hear(START)
        except Broken:
            self.close()
            raise

    def _request(self, question: Any, patience: float) -> Any:
        if self._process is None:
            self._start()
        with contextlib.suppress(OSError):  # the process has ended: reading the answer reports it
            self._pipe.send(question)
        return self._hear(patience)

    def _hear(self, patience: float) -> Any:
        try:
            if not self._pipe.poll(patience):
                self._process.kill()
                self.close()
                raise Broken(f"took more than {patience:.0f} s")
            answer = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join(3)
            code = self._process.exitcode
            self.close()
            raise Broken(f"its process ended with exit code {code}") from None
        if isinstance(answer, Broken):
            raise answer
        return answer


# ---- in the process


def _serve(pipe: Any, load: Callable[[], Find], threads: int) -> None:
    """Send None when ready, or a Broken with the reason; then answer a picture with a Timing and None with the
    memory."""
    import cv2

    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        _only_cores(threads)
        try:
            with quiet():
                find = load()
        except Exception as error:
            pipe.send(Broken(f"can't be made: {type(error).__name__}: {error}"))
            return
        cv2.setNumThreads(threads)  # after loading, because adapters set it, too
        pipe.send(None)
        before = resident("VmRSS")
        while True:
            question = pipe.recv()
            if question is None:
                peak = resident("VmHWM")
                pipe.send(None if before is None or peak is None else Memory(before, peak))
            else:
                pipe.send(_timed(find, *question))


def _timed(find: Find, image: Array, size: Size) -> Timing | Broken:
    try:
        with quiet():
            start, cpu = time.perf_counter(), _cpu()
            grids = find(image, size)
            seconds, cpu = time.perf_counter() - start, _cpu() - cpu
    except Exception as error:
        return Broken(f"{type(error).__name__}: {error}")
    return Timing(seconds, cpu, sum(len(grid.xy) for grid in grids), tuple(grids))


def _cpu() -> float:
    """Processor time of this process and of the programs that it has run, s."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def _only_cores(count: int) -> None:
    """Restrict the process to `count` cores whatever the detector's settings: the last ones, because the first ones
    serve most interrupts."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, cores[-count:])
