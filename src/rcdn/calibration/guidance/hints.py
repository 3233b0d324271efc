"""Instructions for the person with the board: from its present pose to the wanted one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.next_view import NEARER
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

NEAR = 1.15
"""ratio of the distances, in either direction, up to which the distance is right"""
ASIDE = 0.08
"""tolerance of the position of the board's centre, share of the frame's diagonal"""
LEAN = 12.0
"""tolerance of the tilt, degrees"""


@dataclass(frozen=True, eq=False)
class Held:
    """Pose of a board in the terms of the instructions: `middle` (2,) px, its centre, `distance` m, and `lean` (2,)
    degrees: its tilt against the line of sight, in the direction of the picture (x, y) in which it is nearer."""

    middle: Array
    distance: float
    lean: Array

    @classmethod
    def of(cls, middle: Array, centre: Real[Array, " 3"], R: Real[Array, "3 3"]) -> Held:
        """For a board whose centre is at `centre` (3,) m, camera coordinates, and at `middle` px; `R` (3, 3) takes its
        axes to the camera's."""
        distance = float(np.linalg.norm(centre))
        sight, normal = centre / max(distance, 1e-12), R[:, 2]
        aside = (normal - (normal @ sight) * sight)[:2]
        tilt = np.degrees(np.arccos(np.clip(normal @ sight, -1, 1)))
        return cls(middle, distance, tilt * aside / max(float(np.linalg.norm(aside)), 1e-12))


def hint(held: Held, wanted: Held, camera: Camera) -> str:
    """One instruction: the place first, then the distance, then the tilt; "" if the board is in the wanted pose.

    Directions are those of the picture as the camera sees it: right is its right.
    """
    off = (wanted.middle - held.middle) / float(np.hypot(*camera.image_size))
    if np.linalg.norm(off) > ASIDE:
        return f"Move the board {_way(off)} in the picture."
    ratio = held.distance / max(wanted.distance, 1e-12)
    if ratio > NEAR:
        return "Bring the board closer."
    if ratio < 1 / NEAR:
        return "Move the board away."
    turn = wanted.lean - held.lean
    if np.linalg.norm(turn) > LEAN:
        sector = round(np.degrees(np.arctan2(turn[1], turn[0])) / 45) % 8
        return f"Tilt the board: bring its {NEARER[sector]} towards the camera."
    return ""


def _way(off: Array) -> str:
    across = "right" if off[0] > 0 else "left"
    along = "down" if off[1] > 0 else "up"
    x, y = np.abs(off)
    return across if x > 2 * y else along if y > 2 * x else f"{across} and {along}"
