"""Pairs of pictures that belong together where the lag between two cameras changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rcdn.calibration.board_paths import times_of
from rcdn.calibration.changing_lags import Course, by_courses, courses_of
from rcdn.calibration.out_of_step import sentences_on
from rcdn.calibration.rig_graph import sights_of
from rcdn.errors import many
from rcdn.types import Calibration
from rcdn.types.calibration import SIDES


@dataclass(frozen=True, eq=False)
class PairMoments:
    """The `views` of a left and a right camera with their moments: `when` for each camera and view, and the `time` of
    those that are known: the numbers of the pictures' names, if these are the same in all pairs, else the pairs'
    order."""

    views: tuple[Calibration, Calibration]
    when: Sequence[Sequence[str]]
    time: Mapping[str, float]

    @classmethod
    def of(cls, first: Calibration, second: Calibration, pairs: Sequence[tuple[int, int]]) -> PairMoments:
        """The moments of the `pairs` of views and of all other views."""
        named = [times_of(v.name for v in c.views) for c in (first, second)]
        numbers = [[named[c][v.name] for v in each.views] for c, each in enumerate((first, second))]
        if any(numbers[0][a] != numbers[1][b] for a, b in pairs):
            order = [{pair[c]: float(k) for k, pair in enumerate(pairs)} for c in (0, 1)]
            numbers = [[order[c].get(k, float("nan")) for k in range(len(each))] for c, each in enumerate(numbers)]
        when = [[repr(t) if t == t else f"view {k}" for k, t in enumerate(each)] for each in numbers]
        time = {m: t for c in (0, 1) for m, t in zip(when[c], numbers[c], strict=True) if t == t}
        return cls((first, second), when, time)

    def courses(self, constant: bool = False) -> list[Course]:
        """As `courses_of`; none if pictures show several boards."""
        if any(len(set(each)) < len(each) for each in self.when):
            return []
        sights = [
            {key: k for key, k in each.items() if key[0] in self.time} for each in sights_of(self.views, self.when)
        ]
        return courses_of(self.views, sights, self.time, constant)

    def sentences(self, courses: Sequence[Course]) -> list[str]:
        """Sentences on the `courses`, which name pictures."""
        called = [
            {self.time[m]: v.name for m, v in zip(when, camera.views, strict=True) if m in self.time}
            for when, camera in zip(self.when, self.views, strict=True)
        ]
        sentences = sentences_on(courses, [f"the {side} camera" for side in SIDES], called)
        return [text[0].upper() + text[1:] for text in sentences]

    def paired(self, courses: Sequence[Course]) -> list[tuple[int, int]]:
        """The pairs by moments that are counted anew by the `courses`."""
        later, _ = by_courses(self.when, self.time, courses)
        right = {moment: b for b, moment in enumerate(later[1])}
        return [(a, right[m]) for a, m in enumerate(later[0]) if m in self.time and m in right]


def pairs_in_step(
    first: Calibration, second: Calibration, pairs: Sequence[tuple[int, int]]
) -> tuple[Sequence[tuple[int, int]], list[str]]:
    """The `pairs`, by moments that are counted anew where the lag of a camera changes, and sentences on that."""
    moments = PairMoments.of(first, second, pairs)
    courses = moments.courses()
    return (moments.paired(courses), moments.sentences(courses)) if courses else (pairs, [])


def lags_seen(first: Calibration, second: Calibration, pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Sentences on the lag between the cameras, constant or not, that the `pairs` have."""
    moments = PairMoments.of(first, second, pairs)
    return moments.sentences(moments.courses(constant=True))


def odd_pairs(names: list[str]) -> tuple[str, ...]:
    """Advice that names the pairs that were left out."""
    if not names:
        return ()
    some = f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''}"
    those = many(len(names), "pair disagrees", "pairs disagree")
    left_out = "was left out" if len(names) == 1 else "were left out"
    return (f"{those} with the others on where the cameras stand and {left_out}: {some}.",)
