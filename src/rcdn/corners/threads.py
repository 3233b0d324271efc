"""A pool of threads for parallel work: one for the lifetime of its owner instead of one per picture."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any, TypeVar
from weakref import WeakSet

from rcdn import interrupts

Item = TypeVar("Item")
MOST_THREADS = max(64, os.cpu_count() or 1)
"""largest number of threads in a pool; they are started only when there is work for them"""


@cache
def cores() -> int:
    """Number of the processor's cores, asked for once a process: the answer takes as long as a small kernel."""
    return os.cpu_count() or 1


class Threads:
    """A pool of threads, created at its first use and released with this object. Several threads may use it at once.

    A copy, an unpickled object and the object in a forked process each have a pool of their own.
    """

    _pool: ThreadPoolExecutor | None
    _lock: threading.Lock

    def __init__(self) -> None:
        self._forget()
        _every.add(self)

    def __reduce__(self) -> Any:
        return Threads, ()

    def __call__(self, run: Callable[[Item], object], items: Iterable[Item], count: int) -> None:
        """Call `run` with each of `items` on `count` threads, one of which is the caller's.

        An exception of `run` is raised again once all threads have stopped.
        """
        left = deque(items)

        def work() -> None:
            try:
                while True:
                    try:
                        item = left.popleft()
                    except IndexError:
                        return
                    run(item)
            except BaseException:
                left.clear()
                raise

        try:
            others = self._submitted(work, min(count, len(left)) - 1)
        except BaseException:
            left.clear()  # threads that have begun end after their item
            raise
        try:
            work()
        finally:
            busy = [other for other in others if not other.cancel()]  # futures that haven't started are cancelled
            wait(busy)
        for other in busy:
            other.result()

    def _submitted(self, work: Callable[[], None], count: int) -> list[Future[None]]:
        """`count` futures of `work`. Python would wait at exit for a thread that was started but not yet registered in
        its pool, and never signal it to stop. The command therefore defers Ctrl-C meanwhile; in any other program an
        exception here shuts the pool down.
        """
        if count < 1:
            return []
        pool = self._executor()
        try:
            with interrupts.held():
                return [pool.submit(work) for _ in range(count)]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            self._forget()
            raise

    def _executor(self) -> ThreadPoolExecutor:
        with self._lock:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(MOST_THREADS, thread_name_prefix="rcdn")
            return self._pool

    def _forget(self) -> None:
        self._pool, self._lock = None, threading.Lock()


_every: WeakSet[Threads] = WeakSet()


def _after_fork() -> None:
    """Reset all pools: a forked process has the objects but not their threads, and locks that are never released."""
    for threads in list(_every):
        threads._forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
