"""What a verdict says of cameras whose pictures weren't taken at the same moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rcdn.calibration.changing_lags import Course
from rcdn.calibration.limits import RIG_LIMITS, reason
from rcdn.types import Reason

NAMED = 3
"""most stretches of a course that are named one by one"""


def out_of_step(anew: Sequence[str], held: Sequence[str], seen: Sequence[str], rms: float) -> list[Reason]:
    """The reason against cameras of which `held` are those whose lens the others contradict, in a solution that leaves
    an `rms`, px; or against those whose lag changes; none if they are in step. Sentences on courses: `anew`, by which
    moments were counted anew, and `seen`, of lags that the solution still has."""
    counted = [*anew, "Moments were counted anew by that."] if anew else []
    if held:
        return [
            reason(
                "contradiction", len(held), "",
                f"The views of {' and '.join(held)} contradict each other under the lens that each camera has alone: "
                "pictures weren't taken at the same moments, or cameras moved against each other. "
                f"{' '.join([*(counted or seen), 'The lenses are kept as they are alone;'])} "
                "where the cameras stand is less certain than stated.",
                "Trigger the cameras together, or hold the board still in each picture, and look for frames that one "
                "of them lost or has twice.",
                level="bad" if rms > RIG_LIMITS["rig_rms"].fair else "unsure",
            )
        ]  # fmt: skip
    return [
        reason(
            "changing_lag", len(anew), "", " ".join(counted),
            "Look for frames that were lost there, and number pictures by the trigger, not by their order.",
        )
    ] if anew else []  # fmt: skip


def sentences_on(courses: Sequence[Course], names: Sequence[str], called: Sequence[Mapping[float, str]]) -> list[str]:
    """How far cameras lag in the course of a recording. `names` of the cameras; `called`: what the moments of each are
    called, by their time."""
    out = []
    for course in courses:
        moment = called[course.b]
        lags = [_lateness(by) for by in course.moments.tolist()]
        since = [moment.get(t, f"{t:g}") for t in course.since.tolist()]
        parts = [lags[0], *(f"from {at} on {lag}" for at, lag in zip(since[1:], lags[1:], strict=True))]
        if len(parts) > NAMED:
            parts = [lags[0], f"in {len(parts) - 2} steps to {lags[-1]}", f"which it is from {since[-1]} on"]
        first = "at first " if len(parts) > 1 else ""
        out.append(f"{names[course.b]} isn't in step with {names[course.a]}: {first}{', '.join(parts)}.")
    return out


def _lateness(moments: float) -> str:
    """`1 frame late`."""
    if not moments:
        return "in step"
    frames = f"{abs(moments):g} frame{'' if abs(moments) <= 1 else 's'}"
    return f"{frames} {'late' if moments > 0 else 'early'}"
