"""Whether the verdict distinguishes good sets of pictures from bad ones, and whether its first line names the fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.verdict import fails, headline, judge
from rcdn.errors import CalibrationError
from rcdn.types import Board
from rcdn_lab import bad_cases, good_cases
from rcdn_lab.bad_cases import CaseInput

SHOWN = 120
"""characters of the first line that fit a table"""
Step = Callable[[int, int], None] | None
REAL = (
    "opencv-left", "opencv-right", "bouguet", "logicool", "pseye", "bimalka", "sony-hx5v", "stereo1-left",
    "stereo1-right", "trinocular-left", "trinocular-middle", "trinocular-right", "udacity-wide", "gopro", "ocam-fish1",
    "theta", "sourishg-left", "sourishg-right",
)  # fmt: skip
"""public sets of photographs (`rcdn_lab.calibration.sets`) with which people calibrate"""
MIXED = (("opencv-left", "opencv-right"), ("stereo1-left", "stereo1-right"), ("sourishg-left", "sourishg-right"))
"""pairs of sets from two cameras that a person may take for one"""


@dataclass(frozen=True)
class Outcome:
    """Outcome for one set: what was `expected` (`bad`, `good`, `real`), the verdict's `level` (`error`: no
    calibration), the `key` of its first reason, its `first_line`; whether it `passed`, and whether the reason is the
    one that explains the fault (`named`)."""

    case: str
    expected: str
    level: str
    key: str
    first_line: str
    passed: bool
    named: bool


def row(of: Outcome) -> dict[str, Any]:
    """As a table row."""
    return {
        "case": of.case,
        "expected": of.expected,
        "verdict": of.level,
        "reason": of.key,
        "passed": "yes" if of.passed else "NO",
        "named": "yes" if of.named else "NO",
        "first line": of.first_line if len(of.first_line) <= SHOWN else f"{of.first_line[: SHOWN - 1]}…",
    }


def bad_outcome(case: bad_cases.BadCase, seed: int = 0, model: str = "auto") -> Outcome:
    """Passed if the level is unsure or bad, or if calibration fails. `model`: the lens, unless the case specifies its
    own."""
    level, key, line = judged_input(case.make(np.random.default_rng(seed)), model)
    passed = level in ("unsure", "bad", "error")
    return Outcome(case.name, "bad", level, key, line, passed, key in (*case.keys, "error"))


def good_outcome(case: good_cases.GoodCase, seed: int = 0, model: str = "auto") -> Outcome:
    """Passed if the level is good or fair."""
    level, key, line = judged_input(case.make(np.random.default_rng(seed)), model)
    passed = level in ("good", "fair")
    return Outcome(case.name, "good", level, key, line, passed, passed)


def real_outcome(name: str, boards: Sequence[Board], names: Sequence[str], expected: str = "real") -> Outcome:
    """For photographs: passed unless the level is bad (whether the reason for an unsure one is right needs human
    judgement); for `expected` `bad` ones, which show two cameras, passed if it is unsure or bad."""
    level, key, line = judged_input(CaseInput(list(boards), list(names)))
    if expected == "bad":
        return Outcome(
            name, expected, level, key, line, level in ("unsure", "bad", "error"), key in ("one_camera", "error")
        )
    passed = level in ("good", "fair", "unsure")
    return Outcome(name, expected, level, key, line, passed, passed)


def judged_input(given: CaseInput, model: str = "auto") -> tuple[str, str, str]:
    """Level, key of the worst reason ("" if all are good) and first line; `error` and its message if calibration
    fails."""
    try:
        done = calibrate(given.boards, given.spacing, names=given.names, **({"model": model} | given.options))
    except CalibrationError as error:
        return "error", "error", str(error)
    verdict = done.verdict if done.verdict.judged else judge(done)
    key = verdict.against[0].key if fails(verdict, "fair") else ""
    return verdict.level, key, headline(verdict)


def table(seed: int = 0, step: Step = None) -> Iterator[Outcome]:
    """All simulated cases, the bad ones first."""
    cases: list[bad_cases.BadCase | good_cases.GoodCase] = [*bad_cases.CASES, *good_cases.CASES]
    for k, case in enumerate(cases):
        yield bad_outcome(case, seed) if isinstance(case, bad_cases.BadCase) else good_outcome(case, seed)
        if step is not None:
            step(k + 1, len(cases))
