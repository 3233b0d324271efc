"""Lags of whole moments between cameras: cameras that see the same moving board, but don't agree on how they stand, do
so once the moments of one are counted from another one.

A camera that is late by L moments shows at its moment m the board as the others show it at m + L. For each L that gives
two cameras enough common views, the votes of `rig_start` are taken; among those that most views agree with, L is the
one whose views differ least.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from rcdn.calibration.relative_pose import hypotheses
from rcdn.calibration.rig_start import Key, Sights
from rcdn.types import Array, Calibration

FEWEST, HALF = 8, 0.5
"""fewest common views of two cameras for a lag, and their least share of the views of the camera that has fewer: by a
few at the ends of two paths, chance makes cameras agree that see different boards"""
SHARE = 0.75
"""share of the common views that must agree"""
COMPARED = 30
"""largest number of common views that are compared for one lag, evenly spaced ones"""
TRIED = 3
"""largest number of pairs of cameras that are tried between two components, those with most common moments"""


@dataclass(frozen=True)
class Lag:
    """Camera `b` is late by so many `moments` against camera `a`, by the agreement of so many `votes`, which differ by
    `gap` in the median (1: the limit of agreement)."""

    a: int
    b: int
    moments: int
    votes: int
    gap: float


def lags_of(
    cameras: Sequence[Calibration], sights: Sights, time: Mapping[str, float], parts: Sequence[Sequence[int]]
) -> dict[int, int]:
    """By camera, how many whole moments its pictures are late, for all that a lag connects to the largest of the
    `parts`, counted so that most have 0; empty if none does.

    `time`: of each moment, in moments. Components are joined by the pairs with most votes first (maximum spanning
    tree).
    """
    group = [list(part) for part in parts]
    late = {c: 0 for part in parts for c in part}
    found = [lag for p, q in combinations(parts, 2) if (lag := _between(cameras, sights, time, p, q)) is not None]
    for lag in sorted(found, key=lambda each: -each.votes):
        one, other = (next(g for g in group if c in g) for c in (lag.a, lag.b))
        if one is not other:
            by = late[lag.a] + lag.moments - late[lag.b]
            late.update({c: late[c] + by for c in other})
            group = [g for g in group if g is not one and g is not other] + [one + other]
    main = next(g for g in group if parts[0][0] in g)
    counts = [late[c] for c in main]
    usual = max(counts, key=lambda n: (counts.count(n), -abs(n)))
    return {c: late[c] - usual for c in main} if any(n != usual for n in counts) else {}


def late_moments(
    when: Sequence[Sequence[str]], time: Mapping[str, float], lags: Mapping[int, int]
) -> tuple[list[list[str]], dict[str, float]]:
    """For each camera the moments at which its pictures were taken, if those with `lags` are late by so many moments,
    and the time of each moment."""
    out, times = [], dict(time)
    for c, moments in enumerate(when):
        out.append([_later(m, time, lags.get(c, 0)) for m in moments])
        times.update({new: time[m] + lags[c] for new, m in zip(out[c], moments, strict=True) if new not in times})
    return out, times


def _later(moment: str, time: Mapping[str, float], lag: int) -> str:
    """The moment that is nearest to `lag` after another one; a new name if there is none within half a moment."""
    if not lag:
        return moment
    then = time[moment] + lag
    nearest = min(time, key=lambda name: abs(time[name] - then))
    return nearest if abs(time[nearest] - then) < 0.5 else f"{moment} {lag:+d}"


def _between(
    cameras: Sequence[Calibration],
    sights: Sights,
    time: Mapping[str, float],
    first: Sequence[int],
    second: Sequence[int],
) -> Lag | None:
    """The lag between two components with most votes; only cameras that both saw a board at enough moments are
    tried."""
    common = {(a, b): len(sights[a].keys() & sights[b].keys()) for a, b in product(first, second)}
    pairs = sorted((p for p in common if common[p] >= FEWEST), key=lambda p: -common[p])[:TRIED]
    found = [lag for a, b in pairs if (lag := _lag(cameras, sights, time, a, b)) is not None]
    return max(found, key=lambda lag: lag.votes, default=None)


def _lag(cameras: Sequence[Calibration], sights: Sights, time: Mapping[str, float], a: int, b: int) -> Lag | None:
    """The lag of camera b against camera a."""
    one, other = _timed(sights[a], time), _timed(sights[b], time)
    enough = max(FEWEST, HALF * min(len(sights[a]), len(sights[b])))
    apart = {round(s - t) for target in one.keys() & other.keys() for s in one[target][0] for t in other[target][0]}
    best: Lag | None = None
    for moments in sorted(apart - {0}, key=abs):
        views = _common(one, other, moments)
        if len(views) < enough:
            continue
        views = [views[k] for k in np.unique(np.linspace(0, len(views) - 1, COMPARED).round().astype(int))]
        guesses = hypotheses(cameras[a], cameras[b], views)
        T, votes = guesses.most_agreed()
        gap = float(np.median(guesses.nearest(T)[0]))
        if votes >= SHARE * len(views) and (best is None or gap < best.gap):
            best = Lag(a, b, moments, votes, gap)
    return best


def _timed(sights: Mapping[Key, int], time: Mapping[str, float]) -> dict[int, tuple[Array, Array]]:
    """For each target, the times of its views in increasing order, and the views' indices."""
    found: dict[int, list[tuple[float, int]]] = {}
    for (moment, target), view in sights.items():
        found.setdefault(target, []).append((time[moment], view))
    return {
        target: (np.array([t for t, _ in sorted(views)]), np.array([v for _, v in sorted(views)]))
        for target, views in found.items()
    }


def _common(
    one: Mapping[int, tuple[Array, Array]], other: Mapping[int, tuple[Array, Array]], late: int
) -> list[tuple[int, int]]:
    """The views of two cameras that show one board at the same time, within half a moment, if the second one is
    `late`."""
    found = []
    for target in one.keys() & other.keys():
        (s, first), (t, second) = one[target], other[target]
        gaps = np.abs(s[:, None] - (t + late))
        k = gaps.argmin(axis=0)
        near = gaps.min(axis=0) < 0.5
        found += list(zip(first[k[near]].tolist(), second[near].tolist(), strict=True))
    return found
