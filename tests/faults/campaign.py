"""Many faults, for the record: `python tests/faults/campaign.py --kills 100 --out benchmarks/results/faults.json`.

Of each kind of signal as many kills as are asked for, at seeded moments of `rcdn detect`, `calibrate` and `train`; after a few of them the same
command is said again, and must leave what an undisturbed run leaves. Exit code 1 if anything was wrong.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import signal
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import fault_runs
from fault_runs import CALIBRATE, DETECT, TRAINING, Command, Tally

from rcdn.io import write_text
from rcdn.provenance import provenance

KINDS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
SHARES = ((DETECT, 0.56), (CALIBRATE, 0.3), (TRAINING, 0.14))
"""of the kills; a training takes longest"""
CHAIN = 5
"""kills in a row before the command is said again"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="of each kind of signal")
    parser.add_argument(
        "--others", type=int, default=5, help="workers killed, and pairs of runs at once, of each command"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="commands at once, each in a folder of its own")
    parser.add_argument("--out", type=Path, default=None, metavar="FILE.json")
    given = parser.parse_args()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="rcdn-faults-") as folder, ThreadPoolExecutor(given.jobs) as pool:
        tasks = [
            pool.submit(campaign, command, round(given.kills * share + 0.49), given.others, given.seed, Path(folder))
            for command, share in sorted(SHARES, key=lambda pair: -pair[1])
        ]
        counts = {command: tally for task in tasks for command, tally in task.result().items()}
    record = {
        "provenance": provenance(),
        "settings": {"kills": given.kills, "others": given.others, "seed": given.seed},
        "seconds": round(time.monotonic() - begin, 1),
        "faults": {name: dataclasses.asdict(tally) for name, tally in counts.items()},
        "total": {
            key: sum(getattr(tally, key) for tally in counts.values())
            for key in ("kills", "finished", "differences", "orphans", "left_at_once", "left", "tracebacks")
        },
    }
    text = json.dumps(record, indent=1) + "\n"
    print(text)
    if given.out is not None:
        write_text(given.out, text)
    return 0 if all(tally.clean for tally in counts.values()) else 1


def campaign(command: Command, kills: int, others: int, seed: int, folder: Path) -> dict[str, Tally]:
    """All kinds of faults of one command, in a home of its own."""
    home = fault_runs.make_home(folder / command.name)
    known = fault_runs.reference(command, home)
    counts = {}
    for number, kind in enumerate(KINDS):
        tally = counts[f"{command.name}, {kind.name}"] = Tally()
        rng = np.random.default_rng((seed, number))
        tries = 0
        while tally.kills < kills and tries < 3 * kills:
            if tries % CHAIN == 0:
                fault_runs.fresh(command, home)
            fault_runs.disturb(command, home, known, kind, float(rng.uniform(0.0, known.seconds)), tally)
            tries += 1
            if tries % CHAIN == 0 or tally.kills == kills:
                fault_runs.again(command, home, known, tally)
        print(f"{command.name} {kind.name}: {tally}", file=sys.stderr, flush=True)
    if command is not TRAINING:
        tally = counts[f"{command.name}, a worker killed"] = Tally()
        rng = np.random.default_rng((seed, len(KINDS)))
        for _ in range(others):
            fault_runs.kill_a_worker(command, home, known, float(rng.uniform(0.0, known.seconds)), tally)
    tally = counts[f"{command.name}, two at once"] = Tally()
    for _ in range(others if command is not TRAINING else max(1, others // 5)):
        fault_runs.two_at_once(command, home, known, tally)
    return counts


if __name__ == "__main__":
    sys.exit(main())
