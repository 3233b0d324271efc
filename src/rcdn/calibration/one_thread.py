"""Linear algebra on one thread, while cameras are calibrated.

The matrices of a calibration are small: a second thread of BLAS waits for the first one most of the time, busily. With
two threads on two cores a calibration took up to twice the time and four times the processor time that it takes with
one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits the BLAS libraries of NumPy and SciPy to one thread within it; also as a decorator, `@one_thread()`."""
    with threadpool_limits(1, user_api="blas"):
        yield
