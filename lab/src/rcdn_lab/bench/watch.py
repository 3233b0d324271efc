"""`python -m rcdn_lab.bench.watch FOLDER JOBS SAMPLES`: `rcdn detect`, recording the memory after each picture."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator
from contextlib import closing
from multiprocessing import active_children
from pathlib import Path
from typing import Any

from rcdn_lab.bench.resident import resident

Compute = Callable[..., Generator[Any, None, None]]


OFTEN = 0.05
"""Seconds between two measurements of the memory: with many processes a measurement takes as long as a picture."""


def watched(compute: Compute, samples: Path) -> Compute:
    """`compute`, extended to write a line `seconds,pictures,now MB,peak MB` to `samples` after each picture.

    MB: this process and its children, together; shared memory counts for each. `peak`: the sum of the processes'
    maxima.
    """
    start = time.perf_counter()

    def run(*arguments: Any) -> Generator[Any, None, None]:
        with samples.open("w") as file, closing(compute(*arguments)) as results:
            memory, measured = "", -OFTEN
            for number, done in enumerate(results, start=1):
                seconds = time.perf_counter() - start
                if seconds - measured >= OFTEN:
                    memory, measured = f"{_together('VmRSS')},{_together('VmHWM')}", seconds
                file.write(f"{seconds:.4f},{number},{memory}\n")
                yield done

    return run


def _together(field: str) -> str:
    """MB of all processes, "" if the operating system does not report it."""
    mine = resident(field)
    others = [resident(field, child.pid) for child in active_children() if child.pid is not None]
    return "" if mine is None else f"{mine + sum(value for value in others if value is not None):.1f}"


def main(folder: str, jobs: str, samples: str) -> None:
    """Detect in all pictures of `folder`; the detections and the maximum memory of this process are written next to
    `samples`."""
    from rcdn.batch import pool
    from rcdn.cli import app

    pool.compute = watched(pool.compute, Path(samples))
    try:
        app(["detect", folder, "--jobs", jobs, "--json", str(Path(samples).with_suffix(".json"))])
    finally:
        Path(samples).with_suffix(".end").write_text(str(resident("VmHWM") or ""))


if __name__ == "__main__":
    main(*sys.argv[1:])
