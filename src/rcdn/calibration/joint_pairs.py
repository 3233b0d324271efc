"""Pairs of cameras that disagree because their lenses, each from its own views alone, are too uncertain where both see
boards (at the edges of both pictures): lenses and relative pose are solved for jointly, and a board agrees if the
corners of both views do. Shared boards must cost no more than chance has it (χ²)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import default_free, residuals
from rcdn.calibration.relative_pose import FEWEST_PAIRS, Hypotheses, hypotheses
from rcdn.calibration.rig_fit import free_of
from rcdn.calibration.rig_start import Edge, Key, Sights, Turned, averaged, components_of, tree, turned
from rcdn.calibration.rig_task import RigTask
from rcdn.types import Array, Calibration

TRIED = 5
"""largest number of hypotheses on the relative pose from which the joint solution starts"""
ENOUGH = 0.75
"""share of agreeing boards at which a second hypothesis is the last one"""
WIDE = 4.0
"""distance from a hypothesis, as in `Hypotheses.gaps`, that uncertain lenses explain: 20 degrees, or 0.4 of the
boards' distance"""
FAIR = 1.5
"""× the typical mean square of a view's whitened residuals: a board above it disagrees. By chance that of two views of
54 corners scatters by a tenth; boards of other moments have most of their corners at the limit, GATE²"""
CHANCE = 4.0
"""standard deviations by which the sum of squares of a joint solution may exceed what chance adds, six for each shared
board but the first, to that of both cameras apart: uncertain lenses make room for a few wrong boards, but at a cost"""


@dataclass(frozen=True, eq=False)
class JointPairs:
    """Pairs of the `cameras`, whose boards are `sights`; `known`: for each camera, whether its lens is held constant.
    `tried`: the edges of the pairs solved so far, None if refused."""

    cameras: Sequence[Calibration]
    sights: Sights
    known: Sequence[bool]
    tried: dict[tuple[int, int], Edge | None] = field(default_factory=dict)

    def connected(self, edges: Sequence[Edge]) -> list[Edge]:
        """`edges`, and those that joint solutions add between components that share boards, most boards first."""
        out, count = list(edges), len(self.cameras)
        pairs = [(a, b) for a in range(count) for b in range(a + 1, count)]
        for a, b in sorted(pairs, key=lambda pair: -len(self._shared(*pair))):
            of = {c: k for k, part in enumerate(components_of(count, out)) for c in part}
            if of[a] != of[b] and (edge := self.edge(a, b)) is not None:
                out.append(edge)
        return out

    def placed(self, main: Sequence[int], edges: Sequence[Edge]) -> tuple[list[Edge], dict[int, Array], Turned]:
        """Initial poses of the connected cameras `main`, and their boards; where views disagree, with the edges of
        joint solutions instead of those of the views."""
        out = list(edges)
        while True:
            found = averaged(tree(main, out), out)
            places = {c: found[c] for c in main}
            fits = turned(places, self.cameras, self.sights, out)
            more = [self.edge(*pair) for pair in dict.fromkeys(fits.doubted) if pair not in self.tried]
            better = {(e.a, e.b): e for e in more if e is not None}
            if not better:
                return out, places, fits
            out = [e for e in out if (e.a, e.b) not in better] + list(better.values())

    def edge(self, a: int, b: int) -> Edge | None:
        """The edge of two cameras by their joint solution; None unless half of the boards that both saw, and three at
        least, agree, at no cost to other views. From the hypothesis on the relative pose with which most agree."""
        if (a, b) not in self.tried:
            self.tried[a, b] = self._solved(a, b, self._shared(a, b))
        return self.tried[a, b]

    def _shared(self, a: int, b: int) -> list[Key]:
        return [key for key in self.sights[a] if key in self.sights[b]]

    def _solved(self, a: int, b: int, keys: list[Key]) -> Edge | None:
        if len(keys) < FEWEST_PAIRS:
            return None
        guesses = hypotheses(self.cameras[a], self.cameras[b], [(self.sights[a][k], self.sights[b][k]) for k in keys])
        if not (starts := _starts(guesses)):
            return None
        apart, best = self._solution(a, b, {}, np.eye(4)), None
        for many, T in enumerate(starts):
            turns = dict(zip(keys, guesses.nearest(T)[1].tolist(), strict=True))
            edge = self._joined(a, b, turns, T, apart)
            if edge is not None and (best is None or edge.votes > best.votes):
                best = edge
            if best is not None and (best.votes == len(keys) or (many and best.votes >= ENOUGH * len(keys))):
                break
        return best

    def _joined(self, a: int, b: int, turns: dict[Key, int], T: Array, apart: _Solution) -> Edge | None:
        """The edge by the joint solution from the initial guess `T`, with the boards' labels in camera b turned by
        `turns`; `apart`: the solution without shared boards."""
        typical, enough = apart.typical, max(FEWEST_PAIRS, len(turns) / 2)
        both = self._solution(a, b, turns, T)
        views = {key: ((a, self.sights[a][key]), (b, self.sights[b][key])) for key in turns}
        good = {key: turn for key, turn in turns.items() if both.mean(views[key]) <= FAIR * typical}
        if len(good) < enough:
            return None
        if len(good) < len(turns):
            both = self._solution(a, b, good, T)
        freedom = 6 * (len(good) - 1)
        rise = sum(float(both.squares[v].sum() - apart.squares[v].sum()) for v in apart.squares) / typical
        if not rise <= freedom + CHANCE * np.sqrt(2 * freedom):
            return None
        return Edge(a, b, list(turns), both.T, len(good), frozenset(good))

    def _solution(self, a: int, b: int, turns: Mapping[Key, int], T: Array) -> _Solution:
        """The joint solution in which the boards `turns` are shared, from the initial guess `T`; of both lenses apart
        if there are none."""
        when = [[v.name for v in camera.views] for camera in self.cameras]
        task = RigTask.of_two((a, b), self.cameras, self.sights, turns, when, (self.known[a], self.known[b]))
        start = task.start(self.cameras, {a: np.eye(4), b: T})
        free = free_of(start, task.joint) & default_free(start, rig=bool(turns))
        state, _ = robust.initial_fit(start, task.corners, task.sigma, free)
        noise = np.array([self.cameras[c].noise for c in (a, b)])[task.corners.camera]
        gaps = np.nan_to_num(residuals(state, task.corners), nan=np.inf)
        square = np.minimum((gaps**2).sum(axis=1) / (noise**2 + task.sigma**2), robust.GATE**2)
        return _Solution(state.rig[1], {view: square[rows] for view, rows in task.rows.items()})


@dataclass(frozen=True, eq=False)
class _Solution:
    """The relative pose `T` (4, 4), and by (camera, view) the `squares` (M,) of its corners' residuals, whitened by
    their sigma and the noise of each camera alone; GATE² at most, which outliers and corners that a camera cannot see
    have."""

    T: Array
    squares: dict[tuple[int, int], Array]

    def mean(self, views: Collection[tuple[int, int]]) -> float:
        """Mean square of one axis over the corners of `views`."""
        return float(np.concatenate([self.squares[v] for v in views]).mean() / 2)

    @property
    def typical(self) -> float:
        """The median of all views' mean squares."""
        return float(np.median([self.mean([v]) for v in self.squares]))


def _starts(guesses: Hypotheses) -> list[Array]:
    """At most TRIED of the hypotheses (4, 4), those with enough pairs that are not WIDE of them; first that with the
    least sum of distances from all pairs, each limited."""
    found = []
    for T in guesses.T.reshape(-1, 4, 4):
        gaps = guesses.nearest(T)[0]
        if (gaps <= WIDE).sum() >= max(FEWEST_PAIRS, len(guesses) / 2):
            found.append((float(np.minimum(gaps, 2 * WIDE).sum()), T))
    return [T for _, T in sorted(found, key=lambda each: each[0])[:TRIED]]
