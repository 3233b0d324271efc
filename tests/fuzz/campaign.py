"""A campaign: every target gets its share of the time, in processes that may crash or hang;
what they die of is kept."""

from __future__ import annotations

import hashlib
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from tests.fuzz.engine import default_engine
from tests.fuzz.pulse import Pulse
from tests.fuzz.target import Target, scratch_of
from tests.fuzz.worker import Job

HANG = 60.0
"""s by the clock after which an input hangs"""
START = 120.0
"""s by the clock that a process may take to begin"""
DEATHS = 20
"""deaths after which a target is given up"""
WORKER = ("-m", "tests.fuzz.worker")
ENDLESS = 2**62


@dataclass
class Outcome:
    """What became of a target's inputs."""

    target: str
    engine: str
    inputs: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    peak: int = 0
    crashes: int = 0
    hangs: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    samples: dict[str, dict[str, str]] = field(default_factory=dict)
    slowest_data: str = ""

    def row(self) -> dict[str, Any]:
        """As it stands in a record."""
        raised = sum(self.failures.values()) - self.crashes - self.hangs
        return {
            "target": self.target, "engine": self.engine, "inputs": self.inputs, "refused": self.refused,
            "seconds": round(self.seconds, 1), "crashes": self.crashes, "hangs": self.hangs, "failures": raised,
            "slowest_s": round(self.slowest, 3), "slowest": self.slowest_data, "peak_mb": round(self.peak / 2**20),
            "distinct": [
                {"what": key, "times": n, **self.samples.get(key, {})} for key, n in self.failures.most_common()
            ],
        }  # fmt: skip


def run_campaign(
    targets: Sequence[Target],
    engine: str | None,
    seed: int,
    seconds: float,
    inputs: int,
    workers: int,
    report: Callable[[str], None],
) -> list[Outcome]:
    """Run every target for its share of `workers` × `seconds`, or for so many `inputs` each, whichever ends first.

    `engine`: None for each target's usual one."""
    each = workers * seconds / sum(t.share for t in targets)
    jobs = [
        Job(t.name, engine or default_engine(t.guided), seed, 0, inputs or ENDLESS, each * t.share, "") for t in targets
    ]
    jobs.sort(key=lambda job: -job.seconds)

    def one(job: Job) -> Outcome:
        outcome = run_job(job)
        report(
            f"{job.target}: {outcome.inputs} inputs in {outcome.seconds:.0f} s, "
            f"{sum(outcome.failures.values())} failures"
        )
        return outcome

    with ThreadPoolExecutor(workers) as pool:  # threads that wait for processes
        return list(pool.map(one, jobs))


def run_job(job: Job) -> Outcome:
    """Run a job to its end, in one process after another if inputs kill them."""
    outcome = Outcome(job.target, job.engine)
    began = time.monotonic()
    while (left := job.seconds - (time.monotonic() - began)) > 0 and outcome.inputs < job.inputs:
        first = outcome.inputs
        with tempfile.TemporaryDirectory(prefix="rcdn-fuzz-") as folder:
            part = replace(job, first=first, inputs=job.inputs - first, seconds=left, folder=folder)
            death = _watched(part)
            _add(outcome, Path(folder), first, death)
        if death is None:
            break
        if outcome.crashes + outcome.hangs >= DEATHS:
            outcome.failures["given up"] += 1
            break
    outcome.seconds = time.monotonic() - began
    return outcome


def _watched(job: Job) -> str | None:
    """Run a worker; None if it ended well, else what became of it."""
    folder = Path(job.folder)
    pulse = Pulse(folder / "pulse")
    with (folder / "said").open("wb") as said:
        process = subprocess.Popen(
            [sys.executable, *WORKER, json.dumps(asdict(job))], stdout=said, stderr=said, stdin=subprocess.DEVNULL
        )
    began = time.monotonic()
    try:
        while process.poll() is None:
            time.sleep(0.1)
            _, since, _ = pulse.read()
            if time.monotonic() - (since or began) > (HANG if since else START):
                process.send_signal(signal.SIGABRT)  # faulthandler writes down where it is
                time.sleep(0.5)
                return "hang"
    finally:
        process.kill()
        process.wait()
        shutil.rmtree(scratch_of(process.pid), ignore_errors=True)
    return None if process.returncode == 0 else f"exit {process.returncode}"


def _add(outcome: Outcome, folder: Path, first: int, death: str | None) -> None:
    count, since, data = Pulse(folder / "pulse").read()
    tally: dict[str, Any] = json.loads((folder / "tally.json").read_text()) if (folder / "tally.json").exists() else {}
    outcome.inputs = first + tally.get("inputs", 0) if death is None else (count + 1 if since else first)
    outcome.refused += tally.get("refused", 0)
    outcome.peak = max(outcome.peak, tally.get("peak", 0))
    if tally.get("slowest", 0) > outcome.slowest:
        outcome.slowest, outcome.slowest_data = tally["slowest"], tally["slowest_data"]
    for line in _lines(folder / "failures.jsonl"):
        outcome.samples.setdefault(line["key"], {"said": line["said"], "data": line["data"]})
    for key, n in tally.get("failures", {}).items():
        outcome.failures[key] += n
    if death is not None:
        kind = "hang" if death == "hang" else "crash"
        outcome.hangs += kind == "hang"
        outcome.crashes += kind == "crash"
        said = _text(folder / "death") or _text(folder / "said")
        key = f"{kind} ({death}) at {_place(said)}"
        outcome.failures[key] += 1
        outcome.samples.setdefault(key, {"said": said[-1500:], "data": data.hex()})


def _place(said: str) -> str:
    """The deepest frame of rcdn in what faulthandler wrote; else the last words."""
    frames = [line.strip() for line in said.splitlines() if line.strip().startswith("File")]
    ours = [line for line in frames if "/rcdn/" in line] or frames
    return ours[0] if ours else " ".join(said.split()[-12:])


def _lines(path: Path) -> Iterator[dict[str, str]]:
    for line in _text(path).splitlines():
        yield json.loads(line)


def _text(path: Path) -> str:
    return path.read_text(errors="replace") if path.exists() else ""


def keep(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Write the choices of each distinct failure to a file that `--replay` takes."""
    kept = []
    for outcome in outcomes:
        for key, sample in outcome.samples.items():
            name = f"{outcome.target.replace(' ', '-')}-{hashlib.sha256(key.encode()).hexdigest()[:8]}.json"
            folder.mkdir(parents=True, exist_ok=True)
            record = {"target": outcome.target, "what": key, **sample}
            (folder / name).write_text(json.dumps(record, indent=1) + "\n")
            kept.append(folder / name)
    return kept
