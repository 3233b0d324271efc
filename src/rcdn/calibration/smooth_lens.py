"""A smooth correction of a parametric lens model over the sensor, with a stiffness estimated from the corners.

Model errors of a fraction of a pixel bias every calibration that is based on the lens (Schöps et al., Why Having 10,000
Parameters in Your Camera Model Is Better Than Twelve, 2020; mrcal's splined models). A bicubic B-spline over the
stereographic plane represents them. Its prior is its bending energy, with the stiffness that maximises the likelihood
of the corners; its modes without bending would only duplicate focal length and principal point, and are held at zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.calibration.bending import Bending
from rcdn.calibration.bundle import Corners3, Prior, State, default_free
from rcdn.calibration.solver import solve
from rcdn.geometry import zero_correction
from rcdn.types import Array, Calibration

COLUMNS = 12
"""control points along the longer side of the sensor"""
ROUNDS, CONVERGED = 12, 0.05
"""most steps of expectation–maximisation; relative change of the stiffness below which it has converged"""
FIRST = 0.5
"""px: initial size of the correction"""


def with_correction(state: State) -> State:
    """`state` with a correction, initially zero, of its camera."""
    camera = state.cameras[0]
    corrected = replace(camera, correction=zero_correction(camera, COLUMNS))
    return replace(state, cameras=(corrected,), prior=None)


def fitted(state: State, corners: Corners3, weight: Array) -> State:
    """`state` with the correction, its stiffness, and all other unknowns estimated from the corners. Starts from a
    solution without a correction."""
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
        likelier = bending.likelier(values, spread)
        change, variance = abs(np.log(likelier / variance)), likelier
        if change < CONVERGED:
            break
    return replace(bent, prior=_prior(before, bending, variance, spline))


def _prior(before: Prior, bending: Bending, variance: float, spline: slice) -> Prior:
    """The prior `before` of the parameters without a correction, combined with that of the control points `spline`."""
    many = len(before.mean) + spline.stop - spline.start
    rest = np.r_[0 : spline.start, spline.stop : many]
    mean, precision = np.zeros(many), np.zeros((many, many))
    mean[rest], precision[np.ix_(rest, rest)] = before.mean, before.precision
    precision[spline, spline] = bending.energy / variance
    return Prior(mean, precision)


def variance_of(calibration: Calibration) -> float:
    """The variance of the control points of a calibration's smooth correction under its prior, as far as they and their
    covariance determine it; 0 without a correction.

    The covariance is by the scatter of views: where the residuals of a view are correlated, the variance is up to three
    times that under which the correction was fitted, and the prior accordingly weaker.
    """
    camera = calibration.camera
    if camera.correction is None:
        return 0.0
    spline = slice(camera.coefficients, len(camera.parameters))
    return Bending.of(camera).likelier(camera.parameters[spline], calibration.cov[spline, spline])
