"""Pairs of cameras that disagree because their lenses, each from its own views alone, are too uncertain where both see
boards (at the edges of both pictures): lenses and relative pose are solved for jointly, and a board agrees if the
corners of both views do."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import State, residuals
from rcdn.calibration.fixed_boards import FixedBoards
from rcdn.calibration.rig import FEWEST_PAIRS, Hypotheses, hypotheses, matrix
from rcdn.calibration.rig_fit import free_of
from rcdn.calibration.rig_start import Edge, Key, Sights, Turned, averaged, components_of, tree, turned
from rcdn.calibration.rig_task import RigTask
from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

TRIED = 5
"""largest number of hypotheses on the relative pose from which the joint solution starts"""
ENOUGH = 0.75
"""share of agreeing boards at which a second hypothesis is the last one"""
WIDE = 4.0
"""distance from a hypothesis, as in `Hypotheses.gaps`, that uncertain lenses explain: 20 degrees, or 0.4 of the
boards' distance"""
FAIR = 1.5
"""× the usual mean square of a view's whitened residuals: a board above it disagrees. By chance that of two views of 54
corners scatters by a tenth; boards of other moments are at a hundred and more"""


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
        least, agree. From the hypothesis on the relative pose with which most of them do."""
        if (a, b) not in self.tried:
            self.tried[a, b] = self._solved(a, b, self._shared(a, b))
        return self.tried[a, b]

    def _shared(self, a: int, b: int) -> list[Key]:
        return [key for key in self.sights[a] if key in self.sights[b]]

    def _solved(self, a: int, b: int, keys: list[Key]) -> Edge | None:
        if len(keys) < FEWEST_PAIRS:
            return None
        told = hypotheses(self.cameras[a], self.cameras[b], [(self.sights[a][k], self.sights[b][k]) for k in keys])
        best: Edge | None = None
        for many, T in enumerate(_starts(told)):
            T, agreeing = self._agreeing(a, b, keys, T, told.nearest(T)[1])
            if best is None or len(agreeing) > best.votes:
                best = Edge(a, b, keys, T, len(agreeing), frozenset(agreeing))
            if best.votes == len(keys) or (many and best.votes >= ENOUGH * len(keys)):
                break
        return best if best is not None and best.votes >= max(FEWEST_PAIRS, len(keys) / 2) else None

    def _agreeing(self, a: int, b: int, keys: list[Key], T: Array, turns: Array) -> tuple[Array, list[Key]]:
        """T_b_a (4, 4) of the joint solution from the initial guess `T`, with right labels turned by `turns`, and the
        boards that agree in it."""
        task = self._task(a, b, keys, turns)
        start = task.start(self.cameras, {a: np.eye(4), b: T})
        state, _ = robust.initial_fit(start, task.corners, task.sigma, free_of(start, task.joint))
        noise = np.array([self.cameras[c].noise for c in (a, b)])[task.corners.camera]
        square = _mean_squares(state, task, noise)
        both, own = square[: len(keys)], square[len(keys) :]
        usual = float(np.median(own)) if len(own) >= FEWEST_PAIRS else 1.0
        return state.rig[1], [key for key, s in zip(keys, both, strict=True) if s <= FAIR * usual]

    def _task(self, a: int, b: int, keys: Collection[Key], turns: Array) -> RigTask:
        """The joint problem of two cameras: frames are first the shared boards `keys`, then each camera's others."""
        sights = [{k: s[k] for k in keys} if c in (a, b) else {} for c, s in enumerate(self.sights)]
        boards = {key: matrix(self.cameras[a].views[sights[a][key]]) for key in keys}
        labels = {(b, sights[b][key]): int(turn) for key, turn in zip(keys, turns, strict=True)}
        when = [[v.name for v in camera.views] for camera in self.cameras]
        held = [self.known[a], self.known[b]]
        return RigTask.of([a, b], self.cameras, sights, Turned(labels, [], boards), when, held, FixedBoards())


def _starts(told: Hypotheses) -> list[Array]:
    """At most TRIED of the hypotheses (4, 4), those with enough pairs that are not WIDE of them; first that with the
    least sum of distances from all pairs, each limited."""
    found = []
    for T in told.T.reshape(-1, 4, 4):
        gaps = told.nearest(T)[0]
        if (gaps <= WIDE).sum() >= max(FEWEST_PAIRS, len(told) / 2):
            found.append((float(np.minimum(gaps, 2 * WIDE).sum()), T))
    return [T for _, T in sorted(found, key=lambda each: each[0])[:TRIED]]


def _mean_squares(state: State, task: RigTask, noise: Real[Array, " n"]) -> Real[Array, " f"]:
    """(F,) mean square of each frame's whitened residuals, by the corners' sigma and the `noise` (N,), px of one axis,
    of each camera alone; infinite where a camera cannot see a corner."""
    gaps = np.nan_to_num(residuals(state, task.corners), nan=np.inf)
    square = (gaps**2).sum(axis=1) / 2 / (noise**2 + task.sigma**2)
    frame, frames = task.corners.frame, len(task.keys)
    return np.asarray(np.bincount(frame, square, frames) / np.maximum(np.bincount(frame, minlength=frames), 1))
