"""Pictures of several cameras that belong together by the time stamps in their names, which differ by much less than
the time between two pictures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import combinations, pairwise
from math import gcd
from statistics import median

NEAR = 0.2
"""largest difference of stamps in one moment, share of the time between pictures"""
TYPICAL = 5
"""likewise, × the median difference"""
FEWEST = 3
"""fewest moments that two cameras share"""
LEAST = 10**7
"""least whole number that is taken for a time stamp, not for a count of pictures"""
SECOND = 10**9
"""nanoseconds"""
CALENDAR = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.t ]*(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)"
    r"(?:\.(\d{1,9})|[-_,]?(\d{3}|\d{6}|\d{9}))?(?!\d)"
)
SECONDS = re.compile(r"(?<!\d)(?:(\d{1,10})\.(\d{3,9})|(1\d{9})[-_](\d{9}))(?!\d)")
SINCE_1970 = re.compile(r"(?<!\d)(1\d{12}|1\d{15}|1\d{18})(?!\d)")
WHOLE = re.compile(r"(?<!\d)(\d{8,20})(?!\d)")


@dataclass(frozen=True)
class Timed:
    """For each camera the moments of its pictures, `keys`, each the stamp of its first picture; `apart`: the largest
    difference of stamps in one moment, as a text."""

    keys: list[list[str]]
    apart: str


def by_time(stems: Sequence[Sequence[str]]) -> Timed | None:
    """The moments of the pictures of each camera by the time stamps in their names without endings, in lower case.

    None unless all names hold stamps, of one kind, and all cameras are connected by pairs that share FEWEST moments or
    more (all, if one has fewer), most of those of the time in which both took pictures. None, too, if all stamps of a
    moment are equal: names or numbers are equal then; and if cameras with equally many pictures are apart by a constant
    number of them, as where the clock of each began at a time of its own.
    """
    for read in (_calendar, _seconds, _since_1970, _whole):
        times = [[read(stem) for stem in each] for each in stems]
        known = [[t for t in each if t is not None] for each in times]
        if not all(each and len(set(each)) == len(each) == len(all_) for each, all_ in zip(known, times, strict=True)):
            continue
        if (found := _moments(known, in_ns=read is not _whole)) is not None:
            return found
    return None


def _calendar(stem: str) -> int | None:
    """Nanoseconds of a date and time such as 20231105_103105, with or without a fraction."""
    for found in reversed([*CALENDAR.finditer(stem)]):
        *parts, short, long = found.groups()
        try:
            day = datetime(*map(int, parts))  # type: ignore[arg-type]
        except ValueError:
            continue
        return int((day - datetime(1970, 1, 1)).total_seconds()) * SECOND + int((short or long or "0").ljust(9, "0"))
    return None


def _seconds(stem: str) -> int | None:
    """Nanoseconds of seconds with a fraction (1700000000.123456), or with nanoseconds (1700000000_123456000)."""
    found = SECONDS.findall(stem)
    if not found:
        return None
    whole, fraction = (a or b for a, b in zip(found[-1][:2], found[-1][2:], strict=True))
    return int(whole) * SECOND + int(fraction.ljust(9, "0"))


def _since_1970(stem: str) -> int | None:
    """Nanoseconds of milliseconds, microseconds or nanoseconds since 1970, told apart by their digits."""
    found = SINCE_1970.findall(stem)
    return int(found[-1].ljust(19, "0")) if found else None


def _whole(stem: str) -> int | None:
    """A time in a unit that isn't known."""
    found = [n for n in map(int, WHOLE.findall(stem)) if n >= LEAST]
    return found[-1] if found else None


def _moments(times: Sequence[Sequence[int]], in_ns: bool) -> Timed | None:
    """The moments of pictures at these times: with every camera at most once, stamps that follow each other closely,
    and all within NEAR."""
    steps = [median(b - a for a, b in pairwise(sorted(each))) for each in times if len(each) > 1]
    if not steps:
        return None
    bound = NEAR * min(steps)
    sights = sorted((t, c) for c, each in enumerate(times) for t in each)
    gaps = [b[0] - a[0] for a, b in pairwise(sights) if a[1] != b[1] and b[0] - a[0] <= bound]
    if not any(gaps):
        return None
    follows = min(bound, max(TYPICAL * median(gaps), gcd(*(t for t, _ in sights))))
    groups = _grouped(sights, follows, bound)
    first = {sight: group[0][0] for group in groups for sight in group}
    keys = [[str(first[t, c]) for t in each] for c, each in enumerate(times)]
    apart = max(group[-1][0] - group[0][0] for group in groups)
    if not apart or not _connected(times, keys, bound) or _constant_lag(keys):
        return None
    return Timed(keys, _duration(apart) if in_ns else f"{100 * apart / min(steps):.2g} % of the time between pictures")


def _grouped(sights: Sequence[tuple[int, int]], follows: float, bound: float) -> list[list[tuple[int, int]]]:
    """Groups of sights (time, camera), which are in the order of time, without two of one camera: equal times are
    joined first, then those that are next to each other, the nearest first, up to `follows` apart and all within
    `bound`."""
    group_of = [[sight] for sight in sights]
    for k in sorted(range(len(sights) - 1), key=lambda k: sights[k + 1][0] - sights[k][0]):
        if sights[k + 1][0] - sights[k][0] > follows:
            break
        joined = group_of[k] + group_of[k + 1]
        if joined[-1][0] - joined[0][0] <= bound and len({c for _, c in joined}) == len(joined):
            start = k + 1 - len(group_of[k])
            group_of[start : start + len(joined)] = [joined] * len(joined)
    return [group for k, group in enumerate(group_of) if not k or group is not group_of[k - 1]]


def _constant_lag(keys: Sequence[Sequence[str]]) -> bool:
    """Whether cameras have equally many pictures and share moments as in their order, but for constant lags."""
    if len({len(each) for each in keys}) > 1:
        return False
    at = [{key: k for k, key in enumerate(each)} for each in keys]
    lags = [{b[key] - k for key, k in a.items() if key in b} for a, b in combinations(at, 2)]
    return all(len(each) <= 1 for each in lags) and any(each - {0} for each in lags)


def _connected(times: Sequence[Sequence[int]], keys: Sequence[Sequence[str]], bound: float) -> bool:
    """Whether cameras that share moments connect all."""
    reached, others = [0], set(range(1, len(times)))
    for a in reached:  # which grows
        more = sorted(b for b in others if _share(times, keys, a, b, bound))
        reached += more
        others -= {*more}
    return not others


def _share(times: Sequence[Sequence[int]], keys: Sequence[Sequence[str]], a: int, b: int, bound: float) -> bool:
    """Whether two cameras share moments: FEWEST or more, and most of the time in which both took pictures."""
    shared = len(set(keys[a]) & set(keys[b]))
    first = max(min(times[c]) for c in (a, b)) - bound
    last = min(max(times[c]) for c in (a, b)) + bound
    inside = min(sum(first <= t <= last for t in times[c]) for c in (a, b))
    return shared >= min(FEWEST, len(keys[a]), len(keys[b])) and 2 * shared > inside


def _duration(nanoseconds: int) -> str:
    units = (("s", SECOND), ("ms", 10**6), ("µs", 10**3), ("ns", 1))
    unit, size = next((u for u in units if nanoseconds >= u[1]), units[-1])
    return f"{nanoseconds / size:.3g} {unit}"
