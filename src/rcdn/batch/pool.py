"""A pool of workers for many pictures: scheduling, results in input order, and recovery when a worker dies.

The workers are created by a `Crew`: processes on this machine (`rcdn.batch.processes`), or actors of a Ray cluster
(`rcdn.batch.ray`).
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.batch.work import Done, Failure, Picture, Work
from rcdn.batch.workers import HAND, LOST, Crew, Item, Worker
from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.config import DetectorConfig

FEW = 2
"""The largest number of pictures for which starting processes takes longer than it saves."""
BEHIND = 16
"""Pictures per worker that may be in progress, or finished but not yet returned in order; limits the buffered
results."""
STILLBORN = 3
"""Number of consecutive workers that die before they are ready at which the pool gives up."""
PATIENCE = 3.0
"""Seconds that a worker has to end after the request."""


def usable_cores() -> int:
    """The number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def jobs_for(jobs: int, paths: Sequence[Path]) -> int:
    """The number of processes to use for these files: `jobs` (0: one for each core); without videos at most one per
    picture, and 1 for a few pictures."""
    from rcdn.io import is_video

    jobs = jobs or usable_cores()
    if any(is_video(path) for path in paths):
        return jobs
    return 1 if len(paths) <= FEW else min(jobs, len(paths))


def config_of_process(config: DetectorConfig, jobs: int) -> DetectorConfig:
    """`config` for each of `jobs` processes: with several, one thread each unless the user set the number of
    threads."""
    return config if jobs == 1 or config.threads else replace(config, threads=1)


def compute(pictures: Iterable[Picture], work: Work, jobs: int) -> Generator[Done, None, None]:
    """The result of `work` for each of the `pictures`, in their order; with `jobs` > 1 computed in that many processes.

    Raises the errors of making the detector, and RcdnError if no process can be started. Closing the generator ends the
    processes early; pictures that are not finished are then lost.
    """
    if jobs == 1:
        return (work(picture) for picture in pictures)
    from rcdn.batch.processes import Processes

    return share_out(pictures, work, Processes(work), jobs)


def share_out(pictures: Iterable[Picture], work: Work, crew: Crew, jobs: int) -> Generator[Done, None, None]:
    """`compute` with at most `jobs` workers of the `crew`."""
    return _Pool(work, crew, jobs).run(pictures)


class _Pool:
    def __init__(self, work: Work, crew: Crew, jobs: int) -> None:
        self._work = work
        self._crew = crew
        self._jobs = jobs
        self._workers: list[Worker] = []
        self._new: deque[Item] = deque()
        self._again: deque[Item] = deque()
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
                if any(w.items or not w.ready for w in self._workers):
                    for worker, message in self._crew.hear(self._workers):
                        self._heard(worker, message)
        finally:
            self._close()

    def _take(self, source: Iterator[Picture]) -> bool:
        """Take as many pictures from `source` as can be started soon; False if there are no more."""
        each = HAND + 1 if any(w.ready for w in self._workers) else 1
        while self._taken - self._given < BEHIND * self._jobs:
            if len(self._new) + sum(len(w.items) for w in self._workers) >= each * self._jobs:
                break
            picture = next(source, None)
            if picture is None:
                return False
            if self._work.needed(picture):
                self._new.append(Item(self._taken, picture))
            else:
                self._done[self._taken] = self._work(picture)
            self._taken += 1
        return True

    def _hand_out(self) -> None:
        """Assign pictures to idle workers, and start new workers if more pictures are waiting."""
        waiting, room = self._queue()
        idle = [w for w in self._workers if w.ready and not w.items]
        wanted = min(len(waiting), room) - len(idle) - sum(not w.ready for w in self._workers)
        for _ in range(min(wanted, self._jobs - len(self._workers))):
            self._workers.append(self._crew.start())
        for worker in idle[:room]:
            if waiting:
                self._send(worker, waiting.popleft())
        if waiting is self._new:
            self._fill_hands()

    def _queue(self) -> tuple[deque[Item], int]:
        """The queue to process next, and how many of its pictures at the same time. A picture whose worker died is
        processed alone: memory may have run out."""
        busy = [item for w in self._workers for item in w.items]
        if any(item.alone for item in busy) or (self._again and busy):
            return deque(), 0
        return (self._again, 1) if self._again else (self._new, self._jobs)

    def _fill_hands(self) -> None:
        """Assign further pictures to busy workers, so that they read ahead; the last ones wait for the first idle
        worker."""
        for worker in list(self._workers):
            while worker.ready and worker.items and len(worker.items) < HAND and len(self._new) > self._jobs:
                self._send(worker, self._new.popleft())

    def _send(self, worker: Worker, item: Item) -> None:
        try:
            worker.send(item.picture)
        except OSError:  # the worker died while it was idle: this picture isn't the cause
            (self._again if item.alone else self._new).appendleft(item)
            self._lost(worker)
        else:
            worker.items.append(item)

    def _heard(self, worker: Worker, message: Any) -> None:
        if message is LOST:
            self._lost(worker)
        elif isinstance(message, Exception):
            raise message
        elif message is None:
            worker.ready, self._stillborn = True, 0
        else:
            self._done[worker.items.popleft().number] = _frozen(message)

    def _lost(self, worker: Worker) -> None:
        """Handle the death of a worker. The picture that it was processing is tried a second time, and fails if that
        worker dies, too; the others assigned to it hadn't been started and are queued again."""
        self._workers.remove(worker)
        cause = worker.end(time.monotonic() + PATIENCE)
        if not worker.ready:
            self._stillborn += 1
            if self._stillborn >= STILLBORN:
                raise RcdnError(f"the processes that should compute end at once ({cause}); use {self._crew.instead}")
        for place, item in enumerate(worker.items):
            again = replace(item, deaths=item.deaths + (place == 0), alone=True)
            if again.deaths > 1:
                self._done[item.number] = _given_up(item.picture)
            else:
                self._again.append(again)

    def _close(self) -> None:
        """End all workers: idle ones see that there are no more pictures, the others are requested to end."""
        from rcdn.batch.processes import no_interrupts

        with no_interrupts():
            for worker in self._workers:
                worker.dismiss()
            deadline = time.monotonic() + PATIENCE
            for worker in self._workers:
                worker.end(deadline)
            self._workers.clear()


def _given_up(picture: Picture) -> Done:
    """The failure of a picture that ended two workers. The message doesn't depend on how or where the processes ended,
    since it is written to the file of detections."""
    name = picture.name
    message = (
        f"{name}: two processes ended while they computed it, most often for too little memory; use a smaller picture"
    )
    return Done(picture.index, name, (Failure(name, message),))


def _frozen(done: Done) -> Done:
    """`done` with read-only arrays: pickling between processes loses that flag."""
    from rcdn.io import ImageResult

    return replace(done, outcomes=tuple(_rebuilt(o) if isinstance(o, ImageResult) else o for o in done.outcomes))


def _rebuilt(result: Any) -> Any:
    return replace(result, corners=replace(result.corners), boards=tuple(replace(b) for b in result.boards))
