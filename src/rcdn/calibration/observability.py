"""Parameters that the views do not determine: focal length, principal point, aspect ratio.

A plane parallel to the sensor has the same image at a short distance with a short focal length and at a long distance
with a long one; what such views seem to determine comes from the noise of their corners, from paper that bends and from
model errors of the lens (Sturm and Maybank 1999 list the degenerate poses of planes). A standard deviation from noise
alone does not show this. Here the scatter between views is used (`rcdn.calibration.uncertainty.clustered`), and the
poses give the cause and the remedy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcdn.calibration.view_facts import STEEP, tilt_vectors
from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

LOOSE_FOCAL = 0.05
"""standard deviation of the logarithm of the focal length above which it counts as undetermined"""
LOOSE_ASPECT = 0.03
"""the same for the logarithm of fx / fy"""
LOOSE_CENTRE = 0.05
"""the same for the principal point, as a share of the picture's diagonal"""
FEW = 5
"""number of views below which their number is reported as the cause"""
FRONTAL = 15.0
"""degrees between board and sensor: if the tilts are smaller, the focal length is poorly determined"""
FLAT = 3.0
"""degrees: if the tilts are smaller, nothing determines the focal length, even if the views agree on one; a board that
is bent in the same way in all of them simulates a tilt"""
ONE_AXIS = 10.0
"""degrees, RMS of the tilts along the direction in which they are smallest: below it the boards are tilted about one
axis only"""

Quantity = Literal["focal length", "principal point", "aspect ratio"]


@dataclass(frozen=True)
class Undetermined:
    """A `quantity` that the views do not determine: its standard `deviation` (focal length and aspect ratio: relative;
    principal point: px), the `limit` above which it counts as undetermined, the `cause`, and the `remedy`."""

    quantity: Quantity
    deviation: float
    limit: float
    cause: str
    remedy: str

    @property
    def finding(self) -> str:
        """What is undetermined, and why."""
        size = f"{self.deviation:.0f} px" if self.quantity == "principal point" else f"{self.deviation:.0%}"
        known = f"± {size}" if self.deviation < 1e4 else "any value fits"
        return f"The {self.quantity} can't be known from these pictures ({known}): {self.cause}."


def undetermined(calibration: Calibration) -> tuple[Undetermined, ...]:
    """The quantities that the views of `calibration` do not determine, the worst first; () if all are determined.

    The focal length counts as undetermined from a standard deviation of 5 %, the principal point from 5 % of the
    picture's diagonal, the ratio of fx and fy from 3 %; what the calibration held fixed does not count; () without used
    views. If all views face the camera the focal length is undetermined, even if they agree on one.
    """
    if not any(v.pose is not None for v in calibration.used_views):
        return ()
    focal, aspect, *centre = deviations(calibration).tolist()
    if tilt(calibration)[0] < FLAT:
        focal = float("inf")
    diagonal = float(np.hypot(*calibration.camera.image_size))
    found: list[tuple[Quantity, float, float]] = [
        ("focal length", focal, LOOSE_FOCAL),
        ("principal point", max(centre), LOOSE_CENTRE * diagonal),
        ("aspect ratio", aspect, LOOSE_ASPECT),
    ]
    cause = _cause(calibration)
    return tuple(Undetermined(q, d, most, cause, _remedy(calibration)) for q, d, most in found if not d < most)


def deviations(calibration: Calibration) -> Real[Array, " 4"]:
    """(4,) standard deviations of log focal length, log fx / fy, cx and cy (px), from the calibration's covariance,
    which is based on the scatter between views. Infinite with fewer than 2 views."""
    if len(calibration.used_views) < 2 or any(v.pose is None for v in calibration.used_views):
        return np.full(4, np.inf)
    fx, fy = calibration.camera.parameters[:2]
    directions = np.zeros((len(calibration.cov), 4))
    directions[:2, 0] = 0.5 / fx, 0.5 / fy
    directions[:2, 1] = 1 / fx, -1 / fy
    directions[[2, 3], [2, 3]] = 1.0
    return np.sqrt(np.maximum(np.einsum("pq,pr,rq->q", directions, calibration.cov, directions), 0.0))


def tilt(calibration: Calibration) -> tuple[float, float]:
    """Tilt of the boards against the sensor, degrees: its 90 % quantile, and its RMS along the direction in which it is
    smallest."""
    angles = tilt_vectors(calibration.used_views)
    if not len(angles):
        return float("nan"), float("nan")
    least = np.linalg.eigvalsh(angles.T @ angles / len(angles))[0]
    return float(np.quantile(np.hypot(*angles.T), STEEP)), float(np.sqrt(max(least, 0.0)))


def _cause(calibration: Calibration) -> str:
    """The most likely reason why these views determine little."""
    many, (most, least) = len(calibration.used_views), tilt(calibration)
    views = f"{many} view{'s' if many > 1 else ''}"
    if most < FRONTAL:
        return f"the board faces the camera in all {views} (tilted by {most:.0f}° at most)"
    if least < ONE_AXIS and many > 2:
        return f"the board is tilted to one side only in all {views}"
    if many < FEW:
        return f"there are only {views}"
    return f"the {views} contradict each other or are too much alike"


def _remedy(calibration: Calibration) -> str:
    most, _ = tilt(calibration)
    more = (
        "Tilt it by 30° to 45°, to different sides"
        if most < FRONTAL
        else "Add pictures tilted by 30° to 45°, to all sides"
    )
    return f"{more}, near and far, on a stiff flat board."
