"""The verdict as a page shows it: a word, the reasons, and the limits of the checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rcdn.calibration.limits import Limit, growth
from rcdn.calibration.verdict import WORD, meaning, sentences
from rcdn.report.calibration.formats import number, percent, pixels
from rcdn.types import LEVELS, Level, Reason, Verdict


@dataclass(frozen=True)
class ShownReason:
    """A check with its value in its unit."""

    level: Level
    what: str
    value: str
    sentence: str
    action: str


@dataclass(frozen=True)
class ShownVerdict:
    """The verdict in a `word`, and its `summary`: its meaning and the most serious reason; all `reasons`; the
    `limits` of the checks, in px of a picture `growth` times smaller; `notes`: what else to know."""

    level: Level
    word: str
    summary: str
    reasons: tuple[ShownReason, ...]
    limits: tuple[Limit, ...]
    growth: float
    notes: tuple[str, ...]
    levels: tuple[Level, ...] = LEVELS


def shown(
    found: Verdict,
    limits: Sequence[Limit],
    image_size: tuple[int, int],
    advice: Sequence[str] = (),
    several: bool = False,
) -> ShownVerdict:
    """The verdict on pictures of `image_size`, of one camera or `several`; `advice` that isn't one of its reasons is
    noted."""
    stated = sentences(found)
    return ShownVerdict(
        level=found.level,
        word=WORD[found.level],
        summary=" ".join(filter(None, [meaning(found.level, several).capitalize(), *stated[:1]])),
        reasons=tuple(ShownReason(r.level, r.what, value_of(r), r.sentence, r.action) for r in found.reasons),
        limits=tuple(limits),
        growth=growth(image_size),
        notes=tuple(line for line in advice if line not in stated),
    )


def value_of(reason: Reason) -> str:
    """A reason's value in its unit."""
    if reason.unit == "px":
        return pixels(reason.value)
    if reason.unit == "share":
        return percent(reason.value)
    if not reason.unit:  # a count
        return f"{reason.value:g}"
    return f"{number(reason.value)}{'' if reason.unit == '°' else ' '}{reason.unit}"
