"""Distributes tasks over processes, with results in the order of the tasks."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

from rcdn.children import end_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")


def share_out(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int,
    start: Callable[..., None] | None = None,
    given: tuple[Any, ...] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Result]:
    """`work` on each of `tasks`, in their order, by `workers` processes; `start(*given)`, if there is one, is called
    first in each.

    With one worker everything is done in this process. `progress` is called with the number of tasks done and in total.
    """
    if workers == 1:
        if start is not None:
            start(*given)
        yield from _counted(map(work, tasks), len(tasks), progress)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start, (start, given)) as pool:
        try:
            yield from _counted(pool.map(work, tasks), len(tasks), progress)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _start(start: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    """Initialise a process. OpenCV gets one thread, because there is a process for each core."""
    import cv2

    end_with_parent()
    cv2.setNumThreads(1)
    if start is not None:
        start(*given)


def _counted(results: Iterator[Result], total: int, progress: Callable[[int, int], None] | None) -> Iterator[Result]:
    for done, result in enumerate(results, start=1):
        yield result
        if progress:
            progress(done, total)
