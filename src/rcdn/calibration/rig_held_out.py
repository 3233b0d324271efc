"""Epipolar distances of a rig in held-out moments: everything is solved without them, and their corners are compared
with the epipolar planes of that solution."""

from __future__ import annotations

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.choose import FEWEST, FOLDS
from rcdn.calibration.epipolar import Matches, epipolar_gaps, matches
from rcdn.calibration.rig_start import Edge, components_of
from rcdn.calibration.solver import solve
from rcdn.types import Array


def held_out_epipolar(fit: robust.Fit, corners: Corners3, ij: Array, moment: Array) -> dict[tuple[int, int], float]:
    """Root mean square distance, px, of the used corners of each two cameras from their epipolar planes, by k-fold
    cross-validation over moments.

    For each of FOLDS parts of the moments in which several cameras saw the same corners, lenses, places, boards and
    their shape are solved for again from all other moments, starting from the solution `fit`; residuals are those of
    `epipolar_gaps`. `ij` (N, 2): labels of the `corners`; `moment` (F,): that of each frame. Moments that alone connect
    two cameras cannot be held out for them. No entry for two cameras without a held-out corner; none at all with fewer
    than FEWEST shared moments.
    """
    matched = matches(corners, ij, fit.used)
    when = moment[corners.frame]
    shared = np.unique(np.concatenate([when[rows] for rows, _ in matched.values()] or [np.zeros(0, int)]))
    gaps: dict[tuple[int, int], list[Array]] = {}
    for part in (shared[k::FOLDS] for k in range(FOLDS if len(shared) >= FEWEST else 0)):
        out = np.isin(when, part)
        state = solve(fit.state, corners, np.where(fit.used & ~out, fit.weight, 0.0), fit.free).state
        of = _components(len(state.cameras), matched, out)
        for (a, b), (rows, others) in matched.items():
            mine = out[rows]
            if of[a] == of[b] and mine.any():
                gaps.setdefault((a, b), []).append(_gaps(state, corners, a, b, rows[mine], others[mine]))
    every = {pair: np.concatenate(each) for pair, each in gaps.items()}
    known = {pair: each[np.isfinite(each)] for pair, each in every.items()}
    return {pair: float(np.sqrt((each**2).mean())) for pair, each in known.items() if len(each)}


def _components(cameras: int, matched: Matches, out: Array) -> dict[int, int]:
    """By camera, the component that corners outside of the moments `out` (N,) connect it to."""
    edges = [Edge(a, b, [], np.eye(4), 1) for (a, b), (rows, _) in matched.items() if not out[rows].all()]
    return {c: k for k, part in enumerate(components_of(cameras, edges)) for c in part}


def _gaps(state: State, corners: Corners3, a: int, b: int, rows: Array, others: Array) -> Array:
    T = state.rig[b] @ np.linalg.inv(state.rig[a])
    return epipolar_gaps(state.cameras[a], state.cameras[b], T, corners.xy[rows], corners.xy[others])
