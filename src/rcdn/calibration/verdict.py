"""The verdict on a calibration: whether to use it. The terminal, the JSON, the page and the exit code all use the same
one.

Its level is that of the worst reason; the thresholds are in `limits`. The worst reason is shown first; among equally
bad ones a cause (two cameras, a wrong size) comes before its symptoms (a large RMS).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from rcdn.calibration import fit_checks, view_checks
from rcdn.calibration.facts import Facts, measure
from rcdn.types import LEVELS, Calibration, Level, Reason, Verdict

Check = Callable[[Calibration, Facts], Sequence[Reason]]
"""Examines one property; returns reasons, good or not, or none where the property does not exist"""

CHECKS: tuple[Check, ...] = (
    view_checks.one_camera,
    view_checks.picture_size,
    view_checks.spacing,
    view_checks.board_size,
    view_checks.views,
    view_checks.tilt,
    view_checks.determined,
    fit_checks.board,
    view_checks.left_out,
    fit_checks.dropped,
    fit_checks.parameters,
    fit_checks.systematic,
    fit_checks.smooth,
    fit_checks.uneven,
    fit_checks.reach,
    fit_checks.rms,
    fit_checks.held_out,
    view_checks.coverage,
    fit_checks.projections,
)
"""causes before symptoms: among equally bad reasons the first is shown first"""
WORD: dict[Level, str] = {"good": "Good", "fair": "Fair", "unsure": "Unsure", "bad": "Bad"}
MEANING: dict[Level, str] = {
    "good": "use this camera.",
    "fair": "usable with care.",
    "unsure": "",
    "bad": "don't use this camera.",
}


def judge(calibration: Calibration, facts: Facts | None = None) -> Verdict:
    """The verdict on one camera. `facts`: the result of `measure`, if it is available already."""
    facts = facts or measure(calibration)
    return verdict_of([found for check in CHECKS for found in check(calibration, facts)])


def verdict_of(reasons: Sequence[Reason]) -> Verdict:
    """The verdict from these reasons, the worst first; equally bad ones keep their order."""
    ordered = tuple(sorted(reasons, key=lambda r: -LEVELS.index(r.level)))
    return Verdict(ordered[0].level if ordered else "unsure", ordered)


def meaning(level: Level, several: bool = False) -> str:
    """What to do with the camera, or with `several`; "" if the verdict can't say."""
    return MEANING[level].replace("this camera", "these cameras") if several else MEANING[level]


def headline(verdict: Verdict, several: bool = False) -> str:
    """The verdict on a camera, or on `several`, in one line: its meaning, and the worst reason with its remedy."""
    found = meaning(verdict.level, several)
    return " ".join([f"{WORD[verdict.level]}:", *filter(None, [found]), *sentences(verdict)[:1]])


def sentences(verdict: Verdict) -> tuple[str, ...]:
    """The reasons against the calibration with their remedies, the worst first."""
    return tuple(f"{r.sentence} {r.action}".rstrip() for r in verdict.against)


def against_camera(name: str, called: str, verdict: Verdict) -> list[Reason]:
    """The reasons against the camera `name`, one of several, in sentences that begin with how it is `called`."""
    return [
        replace(r, key=f"{name}.{r.key}", what=f"{called}: {r.what}", sentence=f"{called}: {r.sentence}")
        for r in verdict.against
    ]


def fails(verdict: Verdict, limit: Level) -> bool:
    """Whether the verdict is at least as bad as `limit`."""
    return LEVELS.index(verdict.level) >= LEVELS.index(limit)
