"""Radial distortion seen in one picture of a plane: the division model (Fitzgibbon, Simultaneous linear estimation of
multiple view geometry and lens distortion, CVPR 2001), about the picture's centre.

A point at radius r is, without the lens, at r / (1 + c r²). One coefficient c takes nearly all of a fisheye's
distortion, and can be found from the corners of one board beside its homography.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rcdn.native import bind
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

FEWEST = 12
"""least number of points from which the coefficient is estimated"""
BETTER = 0.4
"""largest residual with the coefficient, as a share of that of a homography alone,
with which a lens is seen to distort"""
RANGE, STEPS, EXACT = (-0.97, 0.4), 25, 3e-5
"""coefficients that are tried, times the square of the outermost point's radius; how many; and the width of the
interval around the best of them at which its golden sections end"""
GOLDEN = (5**0.5 - 1) / 2

_division_residuals = bind("rcdn_division_residuals")


@dataclass(frozen=True, eq=False)
class Division:
    """The distortion with `coefficient` c for radii in units of `scale` px about `middle` (2,) px."""

    coefficient: float
    middle: Array
    scale: float

    def undistorted(self, xy: Real[Array, "... 2"]) -> Real[Array, "... 2"]:
        """Where points `xy` (..., 2) px would be without the lens, px."""
        off = (xy - self.middle) / self.scale
        return np.asarray(off / (1 + self.coefficient * _square(off)) * self.scale + self.middle)

    def sees(self, xy: Real[Array, "n 2"]) -> Bool[Array, " n"]:
        """(N,) bool: whether points `xy` (N, 2) px are where the lens shows anything."""
        return np.asarray(1 + self.coefficient * _square((xy - self.middle) / self.scale) > 0)[:, 0]

    def slopes(self, xy: Real[Array, "n 2"]) -> Real[Array, "n 2 2"]:
        """Jacobians (N, 2, 2) of `undistorted` at points `xy` (N, 2) px."""
        off = (xy - self.middle) / self.scale
        factor = (1 + self.coefficient * _square(off))[..., None]
        return np.asarray((factor * np.eye(2) - 2 * self.coefficient * off[:, :, None] * off[:, None]) / factor**2)

    def distorted(self, xy: Real[Array, "... 2"]) -> Real[Array, "... 2"]:
        """The inverse of `undistorted`; NaN where there is none."""
        off = (xy - self.middle) / self.scale
        root = 1 - 4 * self.coefficient * _square(off)
        with np.errstate(invalid="ignore"):
            out = 2 * off / (1 + np.sqrt(np.where(root >= 0, root, np.nan)))
        return np.asarray(out * self.scale + self.middle)


def division_of(plane: Real[Array, "n 2"], xy: Real[Array, "n 2"], image_size: tuple[int, int]) -> Division | None:
    """The distortion seen in points `xy` (N, 2) px of a `plane` (N, 2); None where a homography alone explains them
    nearly as well, or they are too few. `image_size` (width, height) px."""
    if len(xy) < FEWEST:
        return None
    middle, scale = (np.array(image_size) - 1) / 2, float(np.hypot(*image_size)) / 2
    off = (xy - middle) / scale
    unit = 1 / max(float(_square(off).max()), 1e-9)

    def residuals(tried: Real[Array, " c"]) -> Real[Array, " c"]:
        return _residuals(tried * unit, plane, off)

    tried = np.linspace(*RANGE, STEPS)
    best = int(np.argmin(residuals(tried)))
    coefficient, residual = _least(residuals, float(tried[max(best - 1, 0)]), float(tried[min(best + 1, STEPS - 1)]))
    if not residual < BETTER * residuals(np.zeros(1))[0]:
        return None
    return Division(coefficient * unit, middle, scale)


def _least(residuals: Callable[[Array], Array], low: float, high: float) -> tuple[float, float]:
    """Where between `low` and `high` a function that falls and then rises is least, and its value there, by golden
    sections (Kiefer, Sequential minimax search for a maximum, Proc. AMS 1953)."""
    inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    at = residuals(np.array(inner)).tolist()
    while high - low > EXACT:
        if at[0] <= at[1]:
            high, inner, at = inner[1], [0.0, inner[0]], [0.0, at[0]]
            inner[0] = high - GOLDEN * (high - low)
            at[0] = float(residuals(np.array(inner[:1]))[0])
        else:
            low, inner, at = inner[0], [inner[1], 0.0], [at[1], 0.0]
            inner[1] = low + GOLDEN * (high - low)
            at[1] = float(residuals(np.array(inner[1:]))[0])
    best = int(at[1] < at[0])
    return inner[best], at[best]


def _residuals(
    coefficients: Real[Array, " c"], plane: Real[Array, "n 2"], off: Real[Array, "n 2"]
) -> Real[Array, " c"]:
    """(C,) root mean square distances of points at `off` (N, 2) from the centre, in units of the scale, from those of
    the `plane` (N, 2) under the best homography and each of the `coefficients` (C,); infinite where there is none."""
    out = np.empty(len(coefficients))
    plane, off = np.ascontiguousarray(plane, float), np.ascontiguousarray(off, float)
    _division_residuals(coefficients, plane, off, np.empty(off.size), out)
    return out


def _square(off: Real[Array, "... 2"]) -> Real[Array, "... 1"]:
    return np.asarray((off**2).sum(axis=-1, keepdims=True))
