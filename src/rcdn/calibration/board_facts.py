"""What the solved shape of the board says of it: whether its squares are square, and how far it is bent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.types import Calibration


@dataclass(frozen=True)
class BoardFacts:
    """`stretch`: by how much the board's columns are wider apart than its rows (a share); `bend`: how far its corners lie out of a plane, from the
    lowest to the highest, as a share of its longer side. NaN where the shape wasn't solved for."""

    stretch: float
    bend: float


def measure_board(calibration: Calibration) -> BoardFacts:
    """From `calibration.shape`. The columns and rows of a board that looks the same after quarter turns can't be told apart."""
    shape = calibration.shape
    if shape is None or calibration.orientation == "ambiguous_90":
        return BoardFacts(float("nan"), float("nan"))
    sides = plane_of(calibration).points(np.array(shape.size) - 1) * calibration.spacing
    step = float(np.mean(sides / np.maximum(np.array(shape.size) - 1, 1)))
    return BoardFacts(shape.stretch / step, shape.bend / float(max(sides)))
