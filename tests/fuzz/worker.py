"""A process that runs inputs of one target until its time or its number is up, and may die of them."""

from __future__ import annotations

import faulthandler
import json
import os
import sys
import time
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

BETWEEN = 1.0
"""s between what a worker writes down"""


@dataclass(frozen=True)
class Job:
    """What a worker does: inputs of `target` from number `first` on, by `seed`; at most `inputs` of them,
    for at most `seconds`."""

    target: str
    engine: str
    seed: int
    first: int
    inputs: int
    seconds: float
    folder: str


def main(text: str) -> None:
    """Run the Job that is given as JSON. Its folder gets `pulse`, `tally.json`, `failures.jsonl` and,
    if the process dies, `death`."""
    job = Job(**json.loads(text))
    folder = Path(job.folder)
    faulthandler.enable((folder / "death").open("w"), all_threads=False)
    from tests.fuzz import kernels

    kernels.record()
    with _instrumented(job.engine):
        from tests.fuzz.targets import TARGETS
    from tests.fuzz import engine, guard
    from tests.fuzz.pulse import Pulse

    guard.bound_memory()
    target = TARGETS[job.target]
    with guard.strict() as printed, (folder / "failures.jsonl").open("a") as failures:
        target.make(_no_choices())  # what is made once doesn't count as an input's time
        watch = guard.Guard(target, printed)
        pulse = Pulse(folder / "pulse")
        ending = time.monotonic() + job.seconds
        written = 0.0

        def one(data: bytes) -> None:
            nonlocal written
            now = time.monotonic()
            if now - written > BETWEEN or watch.tally.inputs >= job.inputs:
                written = now
                _write(folder / "tally.json", watch, guard.peak_memory())
                if now > ending or watch.tally.inputs >= job.inputs:
                    os._exit(0)
            pulse.beat(job.first + watch.tally.inputs, data)
            if failure := watch.run(data):
                line = asdict(failure) | {"key": failure.key, "data": data.hex()}
                if watch.tally.failures[failure.key] <= 3:
                    failures.write(json.dumps(line) + "\n")
                    failures.flush()

        if job.engine == "atheris":
            engine.by_coverage(job.seed + job.first, one)
        else:
            engine.by_chance(job.seed, job.target, job.first, one)


def _instrumented(engine: str) -> Any:
    """What is imported reports what code is reached, where the engine wants to know."""
    if engine != "atheris":
        return nullcontext()
    import atheris

    return atheris.instrument_imports(include=["rcdn"], enable_loader_override=False)


def _no_choices() -> Any:
    from tests.fuzz.source import Source

    return Source(b"")


def _write(path: Path, watch: Any, peak: int) -> None:
    tally = asdict(watch.tally)
    tally["slowest_data"] = watch.tally.slowest_data.hex()
    new = path.with_suffix(".new")
    new.write_text(json.dumps(tally | {"peak": peak}))
    new.replace(path)


if __name__ == "__main__":
    main(sys.argv[1])
