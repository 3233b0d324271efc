"""What the views can't settle: focal length, principal point, aspect ratio.

A plane parallel to the sensor looks the same near a wide lens and far from a long one: what such views seem to say about the focal length
comes from the noise of their corners, from paper that bends and from a lens model that is nearly right (Sturm and Maybank 1999 list
the degenerate poses of planes). A deviation that knows of noise alone doesn't tell. Here it is judged by how much views contradict each other
(`rcdn.calibration.uncertainty.clustered`), and the poses say why and what to do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

LOOSE_FOCAL = 0.05
"""standard deviation of the logarithm of the focal length from which on it counts as unknown"""
LOOSE_ASPECT = 0.03
"""the same of fx / fy"""
LOOSE_CENTRE = 0.05
"""of the picture's diagonal: the same of the principal point"""
FEW = 5
"""views, below which their number is why"""
FRONTAL = 15.0
"""degrees between board and sensor: a set tilted by less hardly tells the focal length"""
FLAT = 3.0
"""degrees: a set tilted by less tells nothing, whatever its views agree on; a board that is bent alike in all of them pretends a tilt"""
ONE_AXIS = 10.0
"""degrees, RMS, by which boards are tilted to the other side than the usual one: less is one axis"""

Quantity = Literal["focal length", "principal point", "aspect ratio"]


@dataclass(frozen=True)
class Unsettled:
    """A `quantity` that the views don't settle: its `deviation` (focal length and aspect ratio: a share; principal point: px) and the
    `limit` beyond which it counts as unknown, why (`cause`), and what to do (`remedy`)."""

    quantity: Quantity
    deviation: float
    limit: float
    cause: str
    remedy: str

    @property
    def finding(self) -> str:
        """What isn't known, and why."""
        size = f"{self.deviation:.0f} px" if self.quantity == "principal point" else f"{self.deviation:.0%}"
        known = f"± {size}" if self.deviation < 1e4 else "any value fits"
        return f"The {self.quantity} can't be known from these pictures ({known}): {self.cause}."

    @property
    def sentence(self) -> str:
        """What isn't known, why, and what to do."""
        return f"{self.finding} {self.remedy}"


def unsettled(calibration: Calibration) -> tuple[Unsettled, ...]:
    """What the views of `calibration` don't settle, the gravest first; () if all is settled.

    The focal length counts as unknown from a deviation of 5 % on, the principal point from 5 % of the picture's diagonal, the ratio of fx and fy
    from 3 %; not what the calibration held fixed; nothing without views that were used. Views that all face the camera tell no focal length
    even if they agree on one.
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
    return tuple(Unsettled(q, d, most, cause, _remedy(calibration)) for q, d, most in found if not d < most)


def deviations(calibration: Calibration) -> Real[Array, " 4"]:
    """(4,) standard deviations of log focal length, log fx / fy, cx and cy (px), by the calibration's covariance, which is that of the scatter
    between views. Infinite where there are fewer than 2.
    """
    if len(calibration.used_views) < 2 or any(v.pose is None for v in calibration.used_views):
        return np.full(4, np.inf)
    fx, fy = calibration.camera.parameters[:2]
    directions = np.zeros((len(calibration.cov), 4))
    directions[:2, 0] = 0.5 / fx, 0.5 / fy
    directions[:2, 1] = 1 / fx, -1 / fy
    directions[[2, 3], [2, 3]] = 1.0
    return np.sqrt(np.maximum(np.einsum("pq,pr,rq->q", directions, calibration.cov, directions), 0.0))


def tilt(calibration: Calibration) -> tuple[float, float]:
    """How far the boards are tilted against the sensor, degrees: the most (9 of 10 are less), and RMS to the side to which they are tilted least."""
    normals = np.array([v.pose.R[:, 2] * np.sign(v.pose.R[2, 2]) for v in calibration.used_views if v.pose is not None])
    if not len(normals):
        return float("nan"), float("nan")
    angle = np.degrees(np.arccos(np.clip(normals[:, 2], -1, 1)))
    length = np.maximum(np.hypot(normals[:, 0], normals[:, 1]), 1e-12)
    sideways = normals[:, :2] / length[:, None] * angle[:, None]
    least = np.linalg.eigvalsh(sideways.T @ sideways / len(sideways))[0]
    return float(np.quantile(angle, 0.9)), float(np.sqrt(max(least, 0.0)))


def _cause(calibration: Calibration) -> str:
    """The most likely reason why these views settle little."""
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
