"""Threads that share out work: one pool for as long as its owner lives, not one a picture."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar
from weakref import WeakSet

from rcdn import interrupts

Item = TypeVar("Item")
MOST = max(64, os.cpu_count() or 1)
"""threads of a pool; they are made when there is work for them"""


class Threads:
    """A pool of threads, made at its first use and gone with this object. Several threads may use it at once.

    A copy, a forked process and whoever unpickles it have a pool of their own.
    """

    _pool: ThreadPoolExecutor | None
    _lock: threading.Lock

    def __init__(self) -> None:
        self._forget()
        _every.add(self)

    def __reduce__(self) -> Any:
        return Threads, ()

    def __call__(self, run: Callable[[Item], object], items: Iterable[Item], count: int) -> None:
        """`run` each of `items` on `count` threads, of which the caller's is one. What `run` raises is raised when all have stopped."""
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

        others = self._submitted(work, min(count, len(left)) - 1)
        try:
            work()
        finally:
            busy = [other for other in others if not other.cancel()]  # those that haven't begun aren't waited for
            wait(busy)
        for other in busy:
            other.result()

    def _submitted(self, work: Callable[[], None], count: int) -> list[Future[None]]:
        """So many futures of `work`. A thread that has begun, but that its pool doesn't know yet, would be waited for at the end of the program, and
        never told to end: the command lets Ctrl-C wait meanwhile, in another program it ends the pool."""
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
                self._pool = ThreadPoolExecutor(MOST, thread_name_prefix="rcdn")
            return self._pool

    def _forget(self) -> None:
        self._pool, self._lock = None, threading.Lock()


_every: WeakSet[Threads] = WeakSet()


def _after_fork() -> None:
    """A forked process has the objects, but no threads, and locks that nobody will open."""
    for threads in list(_every):
        threads._forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
