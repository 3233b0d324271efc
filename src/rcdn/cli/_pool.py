"""Pictures on all cores: a few processes, each with its own detector, that survive the death of one of them."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.cli._batch import Done, Failure, Picture, Work
from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.config import DetectorConfig
    from rcdn.io import ImageResult

FEW = 2
"""Pictures for which starting processes takes longer than it saves."""
BEHIND = 16
"""Pictures a process that may be done while the first of them is not: results that wait for their turn stay few."""
STILLBORN = 3
"""Processes in a row that may end before they begin."""
PATIENCE = 3.0
"""Seconds that a process has to end after it was told to."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def usable_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def jobs_for(jobs: int, paths: Sequence[Path]) -> int:
    """How many processes to use for these files: `jobs`, or 0 for one a core; but 1 for a few pictures."""
    from rcdn.io import is_video

    jobs = jobs or usable_cores()
    if any(is_video(path) for path in paths):
        return jobs
    return 1 if len(paths) <= FEW else min(jobs, len(paths))


def one_thread(config: DetectorConfig, jobs: int) -> DetectorConfig:
    """`config` for one of several processes: one thread each, unless the user asked for more."""
    return config if jobs == 1 or config.threads else replace(config, threads=1)


def compute(pictures: Iterable[Picture], work: Work, jobs: int) -> Generator[Done, None, None]:
    """What `work` makes of each of the `pictures`, in their order; with `jobs` > 1 in that many processes.

    Raises what making the detector raises, and RcdnError if no process can be started. Close the generator to end the processes
    early; pictures that are not done are lost then.
    """
    if jobs > 1:
        return _Pool(work, jobs).run(pictures)
    return (work(picture) for picture in pictures)


@dataclass(eq=False)
class _Item:
    """A picture on its way: its `number` in the order; `again`: it was in a process that died."""

    number: int
    picture: Picture
    again: bool = False


class _Worker:
    """One process: `ready` once its detector is made; `item`: what it computes, None if it waits."""

    def __init__(self, work: Work) -> None:
        context = get_context("spawn")  # fork would copy the locks of other threads: OpenCV's, ONNX Runtime's
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, work), name="rcdn-worker", daemon=True)
        try:
            with _no_interrupts():
                self.process.start()
        finally:
            theirs.close()  # then only the process holds its end, and its death ends our reading
        self.ready = False
        self.item: _Item | None = None

    def end(self, deadline: float) -> int | None:
        """End the process, by force after `deadline`; its exit code."""
        self.pipe.close()
        self.process.join(max(0.0, deadline - time.monotonic()))
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        code = self.process.exitcode
        self.process.close()
        return code


class _Pool:
    def __init__(self, work: Work, jobs: int) -> None:
        self._work = work
        self._jobs = jobs
        self._workers: list[_Worker] = []
        self._new: deque[_Item] = deque()
        self._again: deque[_Item] = deque()
        self._done: dict[int, Done] = {}
        self._taken = 0
        self._given = 0
        self._stillborn = 0

    def run(self, pictures: Iterable[Picture]) -> Generator[Done, None, None]:
        source = iter(pictures)
        more = True
        try:
            while True:
                more = more and self._take(source)
                self._hand_out()
                while self._given in self._done:
                    yield self._done.pop(self._given)
                    self._given += 1
                if not more and self._given == self._taken:
                    return
                if any(w.item is not None or not w.ready for w in self._workers):
                    self._collect()
        finally:
            self._close()

    def _take(self, source: Iterator[Picture]) -> bool:
        """Take as many pictures as can be begun at once; False if there are no more."""
        while self._taken - self._given < BEHIND * self._jobs:
            if len(self._new) >= self._jobs - sum(w.item is not None for w in self._workers):
                break
            picture = next(source, None)
            if picture is None:
                return False
            if self._work.needed(picture):
                self._new.append(_Item(self._taken, picture))
            else:
                self._done[self._taken] = self._work(picture)
            self._taken += 1
        return True

    def _hand_out(self) -> None:
        """Give waiting processes something to do, and start one where there is more to do than that."""
        waiting, room = self._queue()
        idle = [w for w in self._workers if w.ready and w.item is None]
        wanted = min(len(waiting), room) - len(idle) - sum(not w.ready for w in self._workers)
        for _ in range(min(wanted, self._jobs - len(self._workers))):
            self._workers.append(_Worker(self._work))
        for worker, item in zip(
            idle, [waiting.popleft() for _ in range(min(len(idle), len(waiting), room))], strict=False
        ):
            self._send(worker, item)

    def _queue(self) -> tuple[deque[_Item], int]:
        """What comes next, and how many of it at once. A picture whose process died goes alone: memory may have run out."""
        busy = [w.item for w in self._workers if w.item is not None]
        if any(item.again for item in busy) or (self._again and busy):
            return deque(), 0
        return (self._again, 1) if self._again else (self._new, self._jobs)

    def _send(self, worker: _Worker, item: _Item) -> None:
        worker.item = item
        try:
            worker.pipe.send(item.picture)
        except OSError:  # it died while it waited: nothing to hold against the picture
            worker.item = None
            self._back(item)
            self._bury(worker)

    def _back(self, item: _Item) -> None:
        (self._again if item.again else self._new).appendleft(item)

    def _collect(self) -> None:
        """Wait until a process has something to say, and hear all that do."""
        speaking = connection.wait([w.pipe for w in self._workers])
        for worker in [w for w in self._workers if w.pipe in speaking]:
            try:
                message = worker.pipe.recv()
            except (EOFError, OSError):
                self._lost(worker)
                continue
            if isinstance(message, Exception):
                raise message
            self._heard(worker, message)

    def _heard(self, worker: _Worker, message: Done | None) -> None:
        if message is None:
            worker.ready, self._stillborn = True, 0
        elif worker.item is not None:
            self._done[worker.item.number] = _frozen(message)
            worker.item = None

    def _lost(self, worker: _Worker) -> None:
        """A process died: its picture gets a second chance, and then is given up."""
        code, item = self._bury(worker), worker.item
        if not worker.ready:
            self._stillborn += 1
            if self._stillborn >= STILLBORN:
                raise RcdnError(f"the processes that should compute end at once ({_cause(code)}); use --jobs 1")
        elif item is not None and item.again:
            name = item.picture.name
            message = f"{name}: the process that computed it ended twice ({_cause(code)}); use a smaller picture"
            self._done[item.number] = Done(item.picture.index, name, (Failure(name, message),))
        elif item is not None:
            self._again.append(replace(item, again=True))

    def _bury(self, worker: _Worker) -> int | None:
        self._workers.remove(worker)
        return worker.end(time.monotonic() + PATIENCE)

    def _close(self) -> None:
        """End all processes: those that wait see their pipe close, the others are told to."""
        with _no_interrupts():
            for worker in self._workers:
                if worker.item is not None or not worker.ready:
                    worker.process.terminate()
                worker.pipe.close()
            deadline = time.monotonic() + PATIENCE
            for worker in self._workers:
                worker.end(deadline)
            self._workers.clear()


def _cause(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            name = signal.Signals(-code).name
            return f"{name}: most often too little memory" if name == "SIGKILL" else name
    return f"exit code {code}"


def _frozen(done: Done) -> Done:
    """`done` with arrays that nobody can change: on the way between processes they lose that."""
    return replace(done, outcomes=tuple(o if isinstance(o, Failure) else _rebuilt(o) for o in done.outcomes))


def _rebuilt(result: ImageResult) -> ImageResult:
    return replace(result, corners=replace(result.corners), boards=tuple(replace(b) for b in result.boards))


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Ctrl-C comes afterwards; a process that is started meanwhile never gets it: the first one decides."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # or the start would do it, and lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ---- in the process


def _serve(pipe: Any, work: Work) -> None:
    """Say None when ready, or why not; then answer each picture with a Done until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    for name in _THREADS:  # before numpy comes: the cores are shared out already
        os.environ.setdefault(name, "1")
    with contextlib.suppress(EOFError, OSError):  # the first process is gone, or needs nothing more
        try:
            _one_thread()
            work.prepare()
        except Exception as error:
            pipe.send(error if isinstance(error, RcdnError) else RcdnError(f"{type(error).__name__}: {error}"))
            return
        pipe.send(None)
        while True:
            pipe.send(work(pipe.recv()))


def _one_thread() -> None:
    import cv2

    cv2.setNumThreads(1)


def _leave(*_: object) -> None:
    """SIGTERM: clean up (a file that is being written), then go."""
    sys.exit(128 + signal.SIGTERM)
