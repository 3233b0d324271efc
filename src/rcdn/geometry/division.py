"""Radial distortion seen in one picture of a plane: the division model (Fitzgibbon, Simultaneous linear estimation of
multiple view geometry and lens distortion, CVPR 2001), about the picture's centre.

A point at radius r is, without the lens, at r / (1 + c r²). One coefficient c takes nearly all of a fisheye's
distortion, and can be found from the corners of one board beside its homography.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry.homography import apply_homographies, homography
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

FEWEST = 12
"""least number of points from which the coefficient is estimated"""
BETTER = 0.4
"""largest residual with the coefficient, as a share of that of a homography alone,
with which a lens is seen to distort"""
RANGE, STEPS, ROUNDS = (-0.97, 0.4), 25, 3
"""coefficients that are tried, times the square of the outermost point's radius; how many, and how often again between
the neighbours of the best"""


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


def division_of(
    plane: Real[Array, "n 2"], xy: Real[Array, "n 2"], image_size: tuple[int, int], rounds: int = ROUNDS
) -> Division | None:
    """The distortion seen in points `xy` (N, 2) px of a `plane` (N, 2); None where a homography alone explains them
    nearly as well, or they are too few.

    `image_size` (width, height) px; `rounds`: how often the best coefficient is refined.
    """
    if len(xy) < FEWEST:
        return None
    middle, scale = (np.array(image_size) - 1) / 2, float(np.hypot(*image_size)) / 2
    off = (xy - middle) / scale
    unit = 1 / max(float(_square(off).max()), 1e-9)
    low, high = RANGE
    for _ in range(1 + rounds):
        tried = np.linspace(low, high, STEPS)
        residuals = _residuals(tried * unit, plane, off)
        best = int(np.argmin(residuals))
        low, high = float(tried[max(best - 1, 0)]), float(tried[min(best + 1, STEPS - 1)])
    if not residuals[best] < BETTER * _residuals(np.zeros(1), plane, off)[0]:
        return None
    return Division(float(tried[best]) * unit, middle, scale)


def _residuals(
    coefficients: Real[Array, " c"], plane: Real[Array, "n 2"], off: Real[Array, "n 2"]
) -> Real[Array, " c"]:
    """(C,) root mean square distances of points at `off` (N, 2) from the centre, in units of the scale, from those of
    the `plane` (N, 2) under the best homography and each of the `coefficients` (C,); infinite where there is none."""
    c = coefficients[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        flat = off / (1 + c * _square(off))
        there = np.isfinite(flat).all(axis=(1, 2))
        H = np.array(
            [homography(plane, at) if fine else np.full((3, 3), np.nan) for at, fine in zip(flat, there, strict=True)]
        )
        mapped = apply_homographies(H, plane)
        root = 1 - 4 * c * _square(mapped)
        gap = off - 2 * mapped / (1 + np.sqrt(np.where(root >= 0, root, np.nan)))
        size = np.sqrt((gap**2).sum(axis=2).mean(axis=1))
    return np.asarray(np.where(np.isfinite(size), size, np.inf))


def _square(off: Real[Array, "... 2"]) -> Real[Array, "... 1"]:
    return np.asarray((off**2).sum(axis=-1, keepdims=True))
