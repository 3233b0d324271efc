"""Workers that are processes on this machine, each with its own detector."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from multiprocessing import connection, get_context
from typing import Any

from rcdn import interrupts
from rcdn.batch.work import Picture, Work
from rcdn.batch.workers import LOST, Item
from rcdn.children import end_with_parent
from rcdn.errors import RcdnError

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Process:
    """One process; see `rcdn.batch.workers.Worker`."""

    def __init__(self, work: Work) -> None:
        context = get_context("spawn")  # fork would copy the locks of other threads: OpenCV's, ONNX Runtime's
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), name="rcdn-worker", daemon=True)
        try:
            with no_interrupts():
                self.process.start()
        finally:
            theirs.close()  # then only the child holds its end, and reading from ours ends when it dies
        self.ready = False
        self.items: deque[Item] = deque()

    def send(self, picture: Picture) -> None:
        self.pipe.send(picture)

    def dismiss(self) -> None:
        if self.items or not self.ready:
            self.process.terminate()
        self.pipe.close()

    def end(self, deadline: float) -> str:
        self.pipe.close()
        self.process.join(max(0.0, deadline - time.monotonic()))
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        code = self.process.exitcode
        self.process.close()
        return _cause(code)


class Processes:
    """Starts processes that run `work`; see `rcdn.batch.workers.Crew`."""

    instead = "--jobs 1"

    def __init__(self, work: Work) -> None:
        self._work = work

    def start(self) -> Process:
        return Process(self._work)

    def hear(self, workers: Sequence[Process]) -> list[tuple[Process, Any]]:
        speaking = connection.wait([w.pipe for w in workers])
        return [(w, _message(w)) for w in workers if w.pipe in speaking]


def _message(worker: Process) -> Any:
    try:
        return worker.pipe.recv()
    except (EOFError, OSError):
        return LOST


def _cause(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            name = signal.Signals(-code).name
            return f"{name}: most often too little memory" if name == "SIGKILL" else name
    return f"exit code {code}"


@contextlib.contextmanager
def no_interrupts() -> Iterator[None]:
    """Defer Ctrl-C until the end of the context. A process started within it never receives the signal: only the parent
    handles it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # otherwise starting a process would do this, and unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with (
            interrupts.held()
        ):  # the mask applies to this thread only: another thread receives the signal, and Python handles it here
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ---- in the worker process


def _serve(pipe: Any, work: Work) -> None:
    """Send None when ready, or the error; then answer each picture with a Done until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    end_with_parent()
    for name in _THREADS:  # before numpy is imported: there is already one process per core
        os.environ.setdefault(name, "1")
    with contextlib.suppress(EOFError, OSError):  # the parent has ended, or has no more pictures
        try:
            one_opencv_thread()
            work.prepare()
        except Exception as error:
            pipe.send(error if isinstance(error, RcdnError) else RcdnError(f"{type(error).__name__}: {error}"))
            return
        pipe.send(None)
        # no limit on its length is needed: the parent sends only HAND pictures in advance
        arrived: queue.SimpleQueue[Picture | None] = queue.SimpleQueue()
        threading.Thread(target=_read, args=(pipe, work, arrived), name="rcdn-reader", daemon=True).start()
        while (picture := arrived.get()) is not None:
            pipe.send(work(picture))


def _read(pipe: Any, work: Work, arrived: queue.SimpleQueue[Picture | None]) -> None:
    """Read each received picture while the previous one is processed; put None at the end."""
    try:
        with contextlib.suppress(EOFError, OSError):
            while True:
                arrived.put(work.loaded(pipe.recv()))
    finally:
        arrived.put(None)


def one_opencv_thread() -> None:
    """Let OpenCV use one thread only: other workers use the other cores."""
    import cv2

    cv2.setNumThreads(1)


def _leave(*_: object) -> None:
    """Handler of SIGTERM: exit with clean-up (of a file that is being written)."""
    sys.exit(128 + signal.SIGTERM)
