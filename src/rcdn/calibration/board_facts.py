"""Properties of the estimated shape of the board: the aspect ratio of its squares, and its bending."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.types import Calibration


@dataclass(frozen=True)
class BoardFacts:
    """`stretch`: relative excess of the distance of the board's columns over that of its rows; `bend`: distance of its
    corners from a plane, from the lowest to the highest, as a share of its longer side. NaN if the shape was not
    estimated."""

    stretch: float
    bend: float


def measure_board(calibration: Calibration) -> BoardFacts:
    """From `calibration.shape`. Columns and rows of a board with quarter-turn symmetry cannot be distinguished: NaN."""
    shape = calibration.shape
    if shape is None or calibration.orientation == "ambiguous_90":
        return BoardFacts(float("nan"), float("nan"))
    sides = plane_of(calibration).points(np.array(shape.size) - 1) * calibration.spacing
    step = float(np.mean(sides / np.maximum(np.array(shape.size) - 1, 1)))
    return BoardFacts(shape.stretch / step, shape.bend / float(max(sides)))
