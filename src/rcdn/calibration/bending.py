"""The bending energy of a smooth correction of a lens, whose prior it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import present
from rcdn.geometry import roughness
from rcdn.types import Array, Camera

FLAT = 1e-9
"""share of the largest eigenvalue of the bending energy, below which a mode has no bending"""
HELD = 1e7
"""× the stiffness: that of modes without bending"""


@dataclass(frozen=True, eq=False)
class Bending:
    """Bending energy of a spline: `energy` (S, S), in which the modes without bending are held at zero, and `many`, the
    number of the other modes."""

    energy: Array
    many: int

    @classmethod
    def of(cls, camera: Camera) -> Bending:
        """For the correction of a camera."""
        energy = roughness(present(camera.correction, "Camera.correction"))
        values, vectors = np.linalg.eigh(energy)
        flat = values <= FLAT * values[-1]
        typical = float(np.median(values[~flat]))
        held = energy + HELD * typical * vectors[:, flat] @ vectors[:, flat].T
        return cls(held / typical, int((~flat).sum()))

    def likelier(self, values: Array, spread: Array) -> float:
        """The variance of the control points that is likelier than that under which they were estimated as `values`
        (S,) with the covariance `spread` (S, S): a step of expectation–maximisation."""
        return float(values @ self.energy @ values + np.sum(self.energy * spread)) / self.many
