"""A lens that follows the glass: a smooth correction over the sensor beside a parametric model, as stiff as the corners ask for.

Errors of a lens model a fraction of a pixel large mislead every calibration that rests on them (Schöps et al., Why Having 10,000 Parameters in
Your Camera Model Is Better Than Twelve, 2020; mrcal's splined models). A bicubic B-spline over the stereographic plane takes them up. Its
prior is the energy of its bending, with the stiffness under which the corners are most likely; what is flat in it would only repeat focal
length and principal point, and is held at nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.bundle import Corners3, Prior, State, default_free
from rcdn.calibration.solver import solve
from rcdn.errors import present
from rcdn.geometry import folds, roughness, zero_correction
from rcdn.types import Array, Camera

COLUMNS = 12
"""control points along the longer side of the sensor"""
ROUNDS, SETTLED = 12, 0.05
"""steps of expectation–maximisation at most; relative change of the stiffness that is none"""
FIRST = 0.5
"""px: the size of a correction to start from"""
FLAT = 1e-9
"""share of the largest eigenvalue of the bending energy, below which a mode is flat"""
HELD = 1e8
"""× the stiffness, of flat modes"""


@dataclass(frozen=True, eq=False)
class Bending:
    """The energy of a spline's bending in its modes: `energy` (S, S) with the flat modes held, `many` modes that may bend."""

    energy: Array
    many: int

    @classmethod
    def of(cls, camera: Camera) -> Bending:
        """Of the correction of a camera."""
        energy = roughness(present(camera.correction, "Camera.correction"))
        values, vectors = np.linalg.eigh(energy)
        flat = values <= FLAT * values[-1]
        typical = float(np.median(values[~flat]))
        held = energy + HELD * typical * vectors[:, flat] @ vectors[:, flat].T
        return cls(held / typical, int((~flat).sum()))


def with_correction(state: State, columns: int = COLUMNS) -> State:
    """`state` with a correction, all zero, on its camera."""
    camera = state.cameras[0]
    corrected = replace(camera, correction=zero_correction(camera, columns))
    return replace(state, cameras=(corrected,), prior=None)


def fitted(state: State, corners: Corners3, weight: Array) -> State:
    """`state` with the correction, its stiffness, and all else where the corners are most likely. Starts from a solution without one."""
    before = state.beforehand
    bent = with_correction(state)
    bending, core = Bending.of(bent.cameras[0]), len(state.cameras[0].parameters)
    spline = slice(core, len(bent.cameras[0].parameters))
    free = default_free(bent, shape=True)
    variance = (FIRST / float(bent.cameras[0].K[0, 0])) ** 2
    for _ in range(ROUNDS):
        bent = replace(bent, prior=_prior(before, bending, variance, spline))
        solution = solve(bent, corners, weight, free, iterations=8)
        bent = solution.state
        values, spread = bent.values[spline], solution.arrow.covariance[spline, spline]
        likelier = float(values @ bending.energy @ values + np.sum(bending.energy * spread)) / bending.many
        change, variance = abs(np.log(likelier / variance)), likelier
        if change < SETTLED:
            break
    return replace(bent, prior=_prior(before, bending, variance, spline))


def _prior(before: Prior, bending: Bending, variance: float, spline: slice) -> Prior:
    """The prior `before` of what there was without a correction, and that of the control points `spline` in between."""
    many = len(before.mean) + spline.stop - spline.start
    rest = np.r_[0 : spline.start, spline.stop : many]
    mean, precision = np.zeros(many), np.zeros((many, many))
    mean[rest], precision[np.ix_(rest, rest)] = before.mean, before.precision
    precision[spline, spline] = bending.energy / variance
    return Prior(mean, precision)


def whole(camera: Camera) -> bool:
    """Whether the correction leaves the map one to one inside the frame."""
    return not folds(camera)
