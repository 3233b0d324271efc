"""Lags that change in the course of a recording: a camera lost a frame, or its clock is faster than that of another.

Cameras in step say the same of their relative pose at every moment. One that is late by L moments does, if its view at
the moment m is compared with where the other one sees the board at m + L, between two of its pictures if L is no whole
number. The relative pose and the course of the lag, constant but for a few steps, are found together: among the
relative poses by single views at any lag, the one for which the course of least cost (Viterbi) has the least cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rcdn.calibration.lags import later, timed
from rcdn.calibration.relative_pose import Hypotheses, hypotheses, matrix
from rcdn.calibration.rig_start import Sights
from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

FEWEST = 12
"""fewest views of a camera, with views of the other one around their moments, for a course of its lag"""
MOST, PER_MOMENT = 4, 4
"""largest lag that is tried, moments; lags tried in a moment"""
COMPARED, STARTS = 40, 8
"""largest numbers of views, evenly spaced ones, that are compared, and whose relative poses are tried"""
SMOOTH = 3.0
"""difference of a board's poses in two pictures, 1 at the limit of agreement of relative poses, up to which it is taken
to have moved from one to the other"""
CHANCE = 0.02
"""difference of two relative poses that chance makes, as in `Hypotheses.gaps`: a tenth of a degree"""
UNKNOWN = 3.0
"""cost of a view at a lag at which the other camera saw nothing; one that agrees has less than 1, one that doesn't 5
or more"""
PRICE = 10.0
"""cost of a change of the lag: that of two views that disagree"""
GAIN, BETTER = 20.0, 4.0
"""least cost that a changing lag saves against a constant one, and least ratio of the differences without and with it,
in the median of the views that it changes"""
FINE = 2.0
"""× CHANCE: differences that no course has to explain"""
NEAR, CLOSE = 1.5, 1e-9
"""× the median time between moments: pictures farther apart tell nothing of the board between them; rounding"""
FEWEST_CHANGED = 3
"""fewest such views"""


@dataclass(frozen=True, eq=False)
class Course:
    """By how many `moments` (S,) camera `b` is late against camera `a`, each from the time `since` (S,) on, in which so
    many of its `views` (S,) were compared; `gain`: what that explains, as a cost."""

    a: int
    b: int
    since: Array
    moments: Array
    views: Array
    gain: float

    @property
    def whole(self) -> Real[Array, " s"]:
        """(S,) `moments` rounded; parts of a moment that all have in common are left out first."""
        base = float(self.moments[int(np.argmax(self.views))])
        return np.asarray(np.floor(base + 0.5) + np.floor(self.moments - base + 0.5))

    def at(self, time: float) -> int:
        """The whole moments of lag at a `time`."""
        return int(self.whole[max(int(np.searchsorted(self.since, time, side="right")) - 1, 0)])


def courses_of(
    cameras: Sequence[Calibration], sights: Sights, time: Mapping[str, float], constant: bool = False
) -> list[Course]:
    """The courses of the lags of cameras whose lag changes, against one whose lag doesn't; `constant`: and of lags that
    don't change, but aren't zero.

    Whose it is shows by the number of others against which it changes; of two alike it is the later one in the order.
    """
    pairs = {
        (a, b): found
        for a, b in combinations(range(len(cameras)), 2)
        if (found := course_of(cameras, sights, time, a, b, constant)) is not None
    }
    odd, left = set[int](), set(pairs)
    while left:
        counts = {c: sum(c in pair for pair in left) for c in range(len(cameras))}
        worst = max(counts, key=lambda c: (counts[c], c))
        odd.add(worst)
        left = {pair for pair in left if worst not in pair}
    out = []
    for c in sorted(odd):
        mine = [pair for pair in pairs if c in pair and len(odd & set(pair)) == 1]
        a, b = max(mine, key=lambda pair: pairs[pair].gain, default=(c, c))
        found = pairs.get((a, b)) if b == c else course_of(cameras, sights, time, b, a, constant)
        if found is not None:
            out.append(found)
    return out


def by_courses(
    when: Sequence[Sequence[str]], time: Mapping[str, float], courses: Sequence[Course]
) -> tuple[list[list[str]], dict[str, float]]:
    """For each camera the moments at which its pictures were taken by the `courses`, in whole moments, and the time of
    each moment."""
    out, times = [list(each) for each in when], dict(time)
    for course in courses:
        mine = when[course.b]
        lags = [course.at(time[m]) if m in time else 0 for m in mine]
        out[course.b] = [later(m, time, lag) if lag else m for m, lag in zip(mine, lags, strict=True)]
        for m, lag, new in zip(mine, lags, out[course.b], strict=True):
            if m in time:
                times.setdefault(new, time[m] + lag)
    return out, times


def course_of(
    cameras: Sequence[Calibration], sights: Sights, time: Mapping[str, float], a: int, b: int, constant: bool = False
) -> Course | None:
    """The course of the lag of camera b against camera a; None if it explains no more than a constant lag, or, with
    `constant`, than none, as far as moving boards tell."""
    guesses = _Guesses.of(cameras, sights, time, a, b)
    if len(guesses.time) < FEWEST:
        return None
    some = guesses.take(_spread(len(guesses.time), COMPARED))
    if some.excess() < GAIN:
        return None
    lags = np.flatnonzero(some.lags == 0) if constant else np.arange(len(some.lags))
    usual, before = some.best(lags)
    T, after = some.best()
    at = guesses.course(T)
    without = lags[np.argmin(guesses.costs(usual)[:, lags].sum(axis=0))]
    changed = at != (without if constant else np.bincount(at).argmax())
    gaps, old = guesses.gaps(T)[np.arange(len(at)), at][changed], guesses.gaps(usual)[changed, without]
    known = np.isfinite(gaps) & np.isfinite(old)
    if before - after < GAIN or known.sum() < FEWEST_CHANGED:
        return None
    if np.median(old[known]) < BETTER * max(float(np.median(gaps[known])), CHANCE / 2):
        return None
    first = np.flatnonzero(np.append(True, np.diff(at) != 0))
    views = np.diff(np.append(first, len(at)))
    return Course(a, b, guesses.time[first], guesses.lags[at[first]], views, before - after)


@dataclass(frozen=True, eq=False)
class _Guesses:
    """Relative poses by each of a camera's views at each of the `lags` (L,), moments: `T` (K, L, Q, 4, 4), Q turns of
    the board, NaN where the other camera saw nothing; the views' `time` (K,), in order, and `reach` (K, L), the boards'
    distances, m."""

    T: Array
    reach: Array
    time: Array
    lags: Array

    @classmethod
    def of(cls, cameras: Sequence[Calibration], sights: Sights, time: Mapping[str, float], a: int, b: int) -> _Guesses:
        """Those of camera b against camera a."""
        one, other = timed(sights[a], time), timed(sights[b], time)
        steps = np.concatenate([np.zeros(0), *(np.diff(s) for s, _ in one.values())])
        unit = float(np.median(steps)) if len(steps) else 1.0
        lags = unit * np.arange(-MOST * PER_MOMENT, MOST * PER_MOMENT + 1) / PER_MOMENT
        parts = [
            cls._of_board(cameras[a], cameras[b], one[target], other[target], lags, unit)
            for target in one.keys() & other.keys()
            if len(one[target][0]) > 1
        ]
        if not parts:
            return cls(np.zeros((0, len(lags), 1, 4, 4)), np.zeros((0, len(lags))), np.zeros(0), lags)
        T, reach, t = (np.concatenate([getattr(p, name) for p in parts]) for name in ("T", "reach", "time"))
        moved = np.flatnonzero(np.isfinite(T[:, lags != 0, 0, 0, 0]).any(axis=1))
        order = moved[np.argsort(t[moved], kind="stable")]
        return cls(T[order], reach[order], t[order], lags)

    @classmethod
    def _of_board(
        cls,
        first: Calibration,
        second: Calibration,
        one: tuple[Array, Array],
        other: tuple[Array, Array],
        lags: Array,
        unit: float,
    ) -> _Guesses:
        """Those of the times and views of one board; moments are `unit` apart."""
        (s, seen), (t, late) = one, other
        then = t[:, None] + lags
        after = np.clip(np.searchsorted(s, then - CLOSE), 1, len(s) - 1)
        share = (then - s[after - 1]) / (s[after] - s[after - 1])
        inside = (share >= -CLOSE) & (share <= 1 + CLOSE)
        path = (np.diff(s) <= NEAR * unit) & (_steps(first, seen) <= SMOOTH)
        k, column = np.nonzero(inside & (path[after - 1] | (lags == 0)))
        ends = [
            hypotheses(first, second, list(zip(seen[j].tolist(), late[k].tolist(), strict=True)))
            for j in (after[k, column] - 1, after[k, column])
            if len(k)
        ]
        T = np.full((*then.shape, len(ends[0].turn) if ends else 1, 4, 4), np.nan)
        reach = np.ones(then.shape)
        if ends:
            w = np.clip(share[k, column], 0, 1)
            T[k, column] = _between(ends[0].T, ends[1].T, w)
            reach[k, column] = (1 - w) * ends[0].reach + w * ends[1].reach
        return cls(T, reach, t, lags)

    def take(self, views: Array) -> _Guesses:
        """Those of some of the views."""
        return replace(self, T=self.T[views], reach=self.reach[views], time=self.time[views])

    def gaps(self, T: Array) -> Real[Array, "k l"]:
        """(K, L) distances from the relative pose T, 1 at the limit of agreement; NaN where nothing was seen."""
        flat = self.T.reshape(-1, *self.T.shape[2:])
        gaps = Hypotheses(flat, (0,) * flat.shape[1], self.reach.ravel()).gaps(T)
        return np.asarray(gaps.min(axis=1).reshape(self.reach.shape))

    def costs(self, T: Array) -> Real[Array, "k l"]:
        """(K, L) costs of the views at the lags, if T is the relative pose."""
        return np.nan_to_num(np.log1p((self.gaps(T) / CHANCE) ** 2), nan=UNKNOWN)

    def excess(self) -> float:
        """The cost without a lag beyond that of differences which chance makes, at the best relative pose."""
        now = replace(self, T=self.T[:, self.lags == 0], reach=self.reach[:, self.lags == 0], lags=np.zeros(1))
        costs = [np.maximum(now.costs(T) - np.log1p(FINE**2), 0.0).sum() for T in now.starts()]
        return float(min(costs, default=0.0))

    def starts(self) -> Real[Array, "c 4 4"]:
        """(C, 4, 4) the relative poses by some of the views."""
        some = self.T[_spread(len(self.T), STARTS)].reshape(-1, 4, 4)
        return np.asarray(some[np.isfinite(some[:, 0, 0])])

    def best(self, constant: Array | None = None) -> tuple[Array, float]:
        """The relative pose with the course of least cost, and that cost; only `constant` ones of these numbers, if
        given."""
        starts = self.starts()
        costs = np.stack([self.costs(T) for T in starts])
        total = _least(costs) if constant is None else costs[:, :, constant].sum(axis=1).min(axis=1)
        best = int(np.argmin(total))
        return starts[best], float(total[best])

    def course(self, T: Array) -> Array:
        """(K,) the lag of each view, by its number, in the course of least cost."""
        costs = self.costs(T)
        sums = [costs[0]]
        for cost in costs[1:]:
            sums.append(np.minimum(sums[-1], sums[-1].min() + PRICE) + cost)
        at = [int(np.argmin(sums[-1]))]
        for before in sums[-2::-1]:
            at.append(at[-1] if before[at[-1]] <= before.min() + PRICE else int(np.argmin(before)))
        return np.array(at[::-1])


def _least(costs: Real[Array, "c k l"]) -> Real[Array, " c"]:
    """(C,) the least costs of courses through the `costs` (C, K, L)."""
    total = costs[:, 0]
    for k in range(1, costs.shape[1]):
        total = np.minimum(total, total.min(axis=1, keepdims=True) + PRICE) + costs[:, k]
    return np.asarray(total.min(axis=1))


def _steps(camera: Calibration, views: Array) -> Real[Array, " n"]:
    """(N − 1,) differences of the board's poses in `views` (N,) that follow each other, 1 at the limit of agreement."""
    T = np.array([matrix(camera.views[k]) for k in views])
    reach = np.linalg.norm(T[:, :3, 3], axis=1)
    return np.array([
        Hypotheses(after[None, None], (0,), np.array([far])).gaps(before)[0, 0]
        for before, after, far in zip(T[:-1], T[1:], reach, strict=False)
    ])  # fmt: skip


def _between(one: Array, other: Array, share: Array) -> Real[Array, "n q 4 4"]:
    """(N, Q, 4, 4) the poses between two, at a `share` (N,) of the way: translations by lines, rotations nearest to the
    mean."""
    w = share[:, None, None, None]
    T = (1 - w) * one + w * other
    U, _, Vt = np.linalg.svd(T[..., :3, :3])
    T[..., :3, :3] = U @ Vt
    return np.asarray(T)


def _spread(count: int, most: int) -> Array:
    """At most so many of the numbers below `count`, evenly spaced."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))
