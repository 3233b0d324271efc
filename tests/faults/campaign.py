"""Many faults, for the record: `python tests/faults/campaign.py --kills 100 --out benchmarks/results/faults.json`.

Of each kind of signal as many kills as are asked for, at seeded moments of `rcdn detect`, `calibrate` and `train`;
after a few of them the same command is run again, and must leave what an undisturbed run leaves. Exit code 1 if
anything was wrong.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import queue
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import fault_runs
from fault_commands import ALONE, CALIBRATE, DETECT, TRAINING, Command, fresh, heed_ctrl_c, make_home
from fault_runs import Reference, Tally

from rcdn.io import write_text
from rcdn.provenance import provenance

KINDS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SHARES = {DETECT: 0.3, ALONE: 0.4, CALIBRATE: 0.2, TRAINING: 0.1}
"""of the kills; a training takes longest"""
CHAIN = 6
"""kills in a row before the command is run again"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="of each kind of signal")
    parser.add_argument(
        "--others", type=int, default=5, help="workers killed, and pairs of runs at once, of each command"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="commands at once, each in a folder of its own")
    parser.add_argument("--out", type=Path, default=None, metavar="FILE.json", help="written anew after each part")
    given = parser.parse_args()
    heed_ctrl_c()
    counts: dict[str, Tally] = {}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rcdn-faults-") as folder, ThreadPoolExecutor(given.jobs) as pool:
        homes = [make_home(Path(folder) / f"{k}") for k in range(given.jobs)]
        known = {command: fault_runs.reference(command, homes[0]) for command in SHARES}
        free = queue.SimpleQueue[Path]()
        for home in homes:
            free.put(home)
        parts = {pool.submit(_in_a_home, free, work, *rest) for work, *rest in _parts(given, known)}
        for done in as_completed(parts):
            name, tally = done.result()
            counts[name] = tally
            print(f"{name}: {tally}", file=sys.stderr, flush=True)
            text = json.dumps(_record(given, counts, time.monotonic() - begin), indent=1) + "\n"
            if given.out is not None:
                write_text(given.out, text)
    print(text)
    return 0 if all(tally.clean for tally in counts.values()) else 1


def _parts(given: Any, known: dict[Command, Reference]) -> Iterator[tuple[Any, ...]]:
    """What is to be done, the longest first."""
    for command, share in sorted(SHARES.items(), key=lambda pair: pair[1]):
        for number, kind in enumerate(KINDS):
            count = math.ceil(given.kills * share)
            yield kills, f"{command.name}, {kind.name}", command, known[command], kind, count, (given.seed, number)
        if command in (DETECT, CALIBRATE):
            yield workers, f"{command.name}, a worker killed", command, known[command], given.others, given.seed
        yield pairs, f"{command.name}, two at once", command, known[command], max(1, given.others // len(SHARES))


def _in_a_home(free: queue.SimpleQueue[Path], work: Callable[..., Tally], name: str, *rest: Any) -> tuple[str, Tally]:
    home = free.get()
    try:
        fresh(rest[0], home, everything=True)
        return name, work(home, *rest)
    finally:
        free.put(home)


def _record(given: Any, counts: dict[str, Tally], seconds: float) -> dict[str, Any]:
    keys = ("kills", "finished", "differences", "orphans", "left_at_once", "left", "tracebacks")
    signals = {k.name: [t for name, t in counts.items() if name.endswith(k.name)] for k in KINDS}
    return {
        "provenance": provenance(),
        "settings": {"kills": given.kills, "others": given.others, "seed": given.seed},
        "seconds": round(seconds, 1),
        "signals": {
            name: {key: sum(getattr(t, key) for t in tallies) for key in keys} for name, tallies in signals.items()
        },
        "total": {key: sum(getattr(tally, key) for tally in counts.values()) for key in keys},
        "faults": {name: dataclasses.asdict(tally) for name, tally in sorted(counts.items())},
    }


# ---- parts


def kills(
    home: Path, command: Command, known: Reference, kind: signal.Signals, count: int, seed: tuple[int, ...]
) -> Tally:
    """So many kills; what was over before its signal came doesn't count."""
    tally, rng = Tally(), np.random.default_rng(seed)
    for tries in range(3 * count):
        if tries % CHAIN == 0:
            fresh(command, home)
        fault_runs.disturb(command, home, known, kind, float(rng.uniform(0.0, known.seconds)), tally)
        if (tries + 1) % CHAIN == 0 or tally.kills == count:
            fault_runs.again(command, home, known, tally)
        if tally.kills == count:
            break
    return tally


def workers(home: Path, command: Command, known: Reference, count: int, seed: int) -> Tally:
    """So many runs that lose a worker."""
    tally, rng = Tally(), np.random.default_rng((seed, len(KINDS)))
    for _ in range(count):
        fault_runs.kill_a_worker(command, home, known, float(rng.uniform(0.0, known.seconds)), tally)
    return tally


def pairs(home: Path, command: Command, known: Reference, count: int) -> Tally:
    """So many pairs of runs on the same outputs."""
    tally = Tally()
    for _ in range(count):
        fault_runs.two_at_once(command, home, known, tally)
    return tally


if __name__ == "__main__":
    sys.exit(main())
