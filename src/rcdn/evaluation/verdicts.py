"""Does the verdict tell good sets of pictures from bad ones, and does its first line say what is wrong?"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.verdict import fails, headline, judge
from rcdn.errors import CalibrationError
from rcdn.evaluation import bad_cases, good_cases
from rcdn.evaluation.bad_cases import CaseInput
from rcdn.types import Board

Step = Callable[[int, int], None] | None


@dataclass(frozen=True)
class Outcome:
    """Of one set: what was `expected` (`bad`, `good`, `real`), the verdict's `level` (`error`: no calibration), the `key` of its first
    reason, its `first_line`; whether it `passed`, and whether the reason is the one that explains the fault (`named`)."""

    case: str
    expected: str
    level: str
    key: str
    first_line: str
    passed: bool
    named: bool


def row(of: Outcome) -> dict[str, Any]:
    """As a line of a table."""
    return {
        "case": of.case,
        "expected": of.expected,
        "verdict": of.level,
        "reason": of.key,
        "passed": "yes" if of.passed else "NO",
        "named": "yes" if of.named else "NO",
        "first line": of.first_line,
    }


def bad_outcome(case: bad_cases.BadCase, seed: int = 0) -> Outcome:
    """Passed if the level is unsure or bad, or no calibration is given."""
    level, key, line = judged_input(case.make(np.random.default_rng(seed)))
    passed = level in ("unsure", "bad", "error")
    return Outcome(case.name, "bad", level, key, line, passed, key in (*case.keys, "error"))


def good_outcome(case: good_cases.GoodCase, seed: int = 0) -> Outcome:
    """Passed if the level is good or fair."""
    level, key, line = judged_input(case.make(np.random.default_rng(seed)))
    passed = level in ("good", "fair")
    return Outcome(case.name, "good", level, key, line, passed, passed)


def real_outcome(name: str, boards: Sequence[Board], names: Sequence[str], spacing: float = 0.025) -> Outcome:
    """Of photographs that others calibrate with: passed unless the level is bad. Whether an unsure one has a true reason is for people."""
    level, key, line = judged_input(CaseInput(list(boards), list(names), spacing=spacing))
    passed = level in ("good", "fair", "unsure")
    return Outcome(name, "real", level, key, line, passed, passed)


def judged_input(given: CaseInput) -> tuple[str, str, str]:
    """Level, key of the gravest reason ("" if all are good) and first line; `error` and its message where no camera is given."""
    try:
        done = calibrate(given.boards, given.spacing, names=given.names, **given.options)
    except CalibrationError as error:
        return "error", "error", str(error)
    verdict = done.verdict or judge(done)
    key = verdict.against[0].key if fails(verdict, "fair") else ""
    return verdict.level, key, headline(verdict)


def table(seed: int = 0, step: Step = None) -> Iterator[Outcome]:
    """All simulated cases, the bad ones first."""
    cases: list[bad_cases.BadCase | good_cases.GoodCase] = [*bad_cases.CASES, *good_cases.CASES]
    for k, case in enumerate(cases):
        yield bad_outcome(case, seed) if isinstance(case, bad_cases.BadCase) else good_outcome(case, seed)
        if step is not None:
            step(k + 1, len(cases))
