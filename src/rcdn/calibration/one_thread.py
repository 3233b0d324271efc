"""Linear algebra on one thread, while cameras are calibrated.

The matrices of a calibration are small: a second thread of BLAS waits for the first one most of the time, busily. With
two threads on two cores a calibration took up to twice the time and four times the processor time that it takes with
one. The limit is the whole process's: other threads' linear algebra keeps to one thread meanwhile, too.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Lock

from threadpoolctl import threadpool_limits


@dataclass
class _Limit:
    """The limit while it is in use by `users`, in whatever order they end."""

    lock: Lock = field(default_factory=Lock)
    users: int = 0
    set_by: threadpool_limits | None = None

    def enter(self) -> None:
        with self.lock:
            self.users += 1
            if self.users == 1:
                self.set_by = threadpool_limits(1, user_api="blas")

    def leave(self) -> None:
        with self.lock:
            self.users -= 1
            self.end()

    def end(self) -> None:
        """Restore the limits before, if they are set and no user is left."""
        if self.users == 0 and self.set_by is not None:
            self.set_by.restore_original_limits()
            self.set_by = None


_limit = _Limit()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits the BLAS libraries of NumPy and SciPy to one thread within it; also as a decorator, `@one_thread()`. When
    the last of several calls in different threads ends, they have as many threads as before the first."""
    limit = _limit
    limit.enter()
    try:
        yield
    finally:
        limit.leave()


def _after_fork() -> None:
    """Begin anew: a forked process has none of the threads that would end the limit, and maybe a lock that is never
    released."""
    global _limit
    before, _limit = _limit, _Limit()
    before.users = 0
    before.end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
