"""Whether to use a calibration: one verdict, from which the terminal, the JSON, the page and the exit code all take theirs.

It is the worst of its reasons; the thresholds are in `limits`. What a person reads first is the gravest reason, and of equally grave ones
that which explains the others: a cause (two cameras, a wrong size) before its symptoms (an RMS).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rcdn.calibration import fit_checks, set_checks, view_checks
from rcdn.calibration.facts import Facts, measure
from rcdn.types import LEVELS, Calibration, Level, Reason, Verdict

Check = Callable[[Calibration, Facts], Sequence[Reason]]
"""Looks at one thing; gives a reason, good or not, or none where there is nothing to look at"""

CHECKS: tuple[Check, ...] = (
    set_checks.one_camera,
    view_checks.picture_size,
    view_checks.spacing,
    view_checks.board_size,
    view_checks.views,
    view_checks.tilt,
    set_checks.settled,
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
"""causes before symptoms: the first of the gravest is what is said first"""
WORD: dict[Level, str] = {"good": "Good", "fair": "Fair", "unsure": "Unsure", "bad": "Bad"}
MEANING: dict[Level, str] = {
    "good": "use this camera.",
    "fair": "usable with care.",
    "unsure": "",
    "bad": "don't use this camera.",
}


def judge(calibration: Calibration, facts: Facts | None = None) -> Verdict:
    """The verdict on one camera. `facts`: what `measure` gave, if it was measured already."""
    facts = facts or measure(calibration)
    return verdict_of([found for check in CHECKS for found in check(calibration, facts)])


def verdict_of(reasons: Sequence[Reason]) -> Verdict:
    """The verdict of these reasons, the gravest first; of equally grave ones the order stays."""
    ordered = tuple(sorted(reasons, key=lambda r: -LEVELS.index(r.level)))
    return Verdict(ordered[0].level if ordered else "unsure", ordered)


def headline(verdict: Verdict) -> str:
    """The verdict in a line: what it means, and the gravest reason with what to do about it."""
    return " ".join([f"{WORD[verdict.level]}:", *filter(None, [MEANING[verdict.level]]), *sentences(verdict)[:1]])


def sentences(verdict: Verdict) -> tuple[str, ...]:
    """What speaks against the calibration and what to do about it, gravest first."""
    return tuple(f"{r.sentence} {r.action}".rstrip() for r in verdict.against)


def fails(verdict: Verdict, limit: Level) -> bool:
    """Whether the verdict is `limit` or worse."""
    return LEVELS.index(verdict.level) >= LEVELS.index(limit)
