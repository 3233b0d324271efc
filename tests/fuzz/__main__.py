"""`python -m tests.fuzz`: a fuzzing campaign over all targets, or inputs that failed, again. See CONTRIBUTING.md."""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path


def main() -> int:
    """Exit code: 0 if no contract was broken, 1 if one was, 2 for wrong use."""
    args = _arguments()
    if args.replay:
        from tests.fuzz.replay import replay

        return max([replay(path, args.minimise) for path in args.replay])
    from tests.fuzz import campaign
    from tests.fuzz.targets import TARGETS

    wanted = args.targets.split(",") if args.targets else list(TARGETS)
    if unknown := sorted(set(wanted) - set(TARGETS)):
        print(f"--targets: {', '.join(unknown)} not known; there are: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    began = time.monotonic()
    targets = [TARGETS[name] for name in wanted]
    outcomes = campaign.run_campaign(targets, args.engine, args.seed, args.seconds, args.inputs, args.workers, print)
    settings = {
        "seconds": args.seconds,
        "inputs": args.inputs,
        "seed": args.seed,
        "engine": args.engine,
        "workers": args.workers,
    }
    rows = [_whole(outcomes, time.monotonic() - began), *(o.row() for o in outcomes)]
    if args.out:
        from rcdn_lab.results import save

        save(args.out, "fuzz", settings, rows)
    for row in rows:
        print("; ".join(f"{k} {v}" for k, v in row.items() if k not in ("distinct", "slowest")))
        for failure in row.get("distinct", ()):
            print(f"    {failure['times']} × {failure['what']}: {failure.get('said', '').strip()[-200:]}")
    for path in campaign.keep(outcomes, args.keep):
        print(f"kept: {path}")
    return int(any(o.failures for o in outcomes))


def _whole(outcomes: list, seconds: float) -> dict:
    """The sums."""
    return {
        "target": "all", "inputs": sum(o.inputs for o in outcomes), "refused": sum(o.refused for o in outcomes),
        "seconds": round(seconds, 1), "crashes": sum(o.crashes for o in outcomes),
        "hangs": sum(o.hangs for o in outcomes),
        "failures": sum(sum(o.failures.values()) - o.crashes - o.hangs for o in outcomes),
        "kinds": sum(len(o.failures) for o in outcomes),
        "slowest_s": round(max(o.slowest for o in outcomes), 3),
        "peak_mb": round(max(o.peak for o in outcomes) / 2**20),
    }  # fmt: skip


def _arguments() -> argparse.Namespace:
    from tests.fuzz.engine import ENGINES

    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60, help="of the whole campaign (60)")
    parser.add_argument("--inputs", type=int, default=0, help="of each target at most (0: as many as fit)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--targets", help="names, with commas between them (all)")
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        help="of all targets (atheris for those that read text, where it is installed; else random)",
    )
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes at a time (one a processor)"
    )
    parser.add_argument("--out", type=Path, help="the record to write")
    parser.add_argument(
        "--keep", type=Path, default=Path("runs/fuzz"), help="folder for inputs that failed (runs/fuzz)"
    )
    parser.add_argument("--replay", type=Path, nargs="+", help="run what was kept again, in this process")
    parser.add_argument("--minimise", action="store_true", help="with --replay: look for fewer choices that fail alike")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
