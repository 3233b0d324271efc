"""Reasons for rejecting a frame: too far, moving, dark, overexposed, blurred, or redundant. Each check returns a
sentence, "" if it is passed."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from rcdn.calibration.guidance.quality import Quality
from rcdn.calibration.limits import growth
from rcdn.calibration.outlines import distances, outline
from rcdn.types import Array, Board

PITCH = 8.0
"""px between neighbouring corners, below which a board is too far away"""
MOVING = 0.03
"""diagonals of the frame per second above which a board is moving"""
HOLD = 0.3
"""s for which it must be still"""
GAP = 1.0
"""s without a frame, after which the motion of the board is unknown"""
BLUR, BLUR_SHARE = 1.5, 0.12
"""px of blur (more if the frame is larger than 1280 px), and share of a square's side: a frame that exceeds both is
blurred"""
CONTRAST, CLIPPED = 25.0, 0.6
"""least difference between black and white squares, grey levels, and largest share of overexposed white squares"""
SAME = 0.02
"""diagonals by which a board's outline must differ from those of all accepted pictures"""


TAKEN = "A picture like this one is there already."


def too_small(board: Board) -> str:
    """Squares that are too small: the detector finds them, but less precisely."""
    side = pitch(board)
    return f"The board is too far away: its squares have only {side:.0f} px." if side < PITCH else ""


def poor(found: Quality) -> str:
    """Too dark, too little contrast, or overexposed."""
    if np.isfinite(found.contrast) and found.contrast < CONTRAST:
        return "The board is too dark, or has too little contrast: more light."
    if found.clipped > CLIPPED:
        return "The white squares are overexposed: less light, or a shorter exposure."
    return ""


def blurred(board: Board, found: Quality) -> str:
    """Out of focus, or moved while the picture was taken."""
    if found.blur <= max(BLUR * growth(board.image_size), BLUR_SHARE * pitch(board)) or np.isnan(found.blur):
        return ""
    return (
        "The picture is blurred: hold the board still, in more light, "
        "neither too near nor too far for the lens to be sharp."
    )


def taken(board: Board, others: Collection[Board]) -> str:
    """A board in the same position as one of the `others` adds no information, and has the same errors."""
    if not others:
        return ""
    gaps = distances(np.stack([outline(b) for b in others]), outline(board))
    return TAKEN if gaps.min() < SAME else ""


class Stillness:
    """Tracks, frame by frame, whether the board has been still for HOLD seconds."""

    def __init__(self) -> None:
        self._last: tuple[float, Array] | None = None
        self._since = 0.0

    def lost(self) -> None:
        """Handle a frame without the board: start again."""
        self._last = None

    def moving(self, board: Board, time: float) -> str:
        """The check for the `board` at `time` s."""
        here, last = outline(board), self._last
        if last is None or not 0 < time - last[0] <= GAP or _speed(last, (time, here)) > MOVING:
            self._since = time
        self._last = (time, here)
        return "Hold the board still." if time - self._since < HOLD else ""


def _speed(before: tuple[float, Array], after: tuple[float, Array]) -> float:
    """Diagonals per second between outlines (4, 2) at times in s."""
    return float(distances(before[1][None], after[1])[0]) / (after[0] - before[0])


def pitch(board: Board) -> float:
    """Median distance between neighbouring corners of a row, px; 0 if there are none."""
    order = np.lexsort((board.ij[:, 0], board.ij[:, 1]))
    ij, xy = board.ij[order], board.xy[order]
    near = (np.diff(ij[:, 0]) == 1) & (np.diff(ij[:, 1]) == 0)
    gaps = np.linalg.norm(np.diff(xy, axis=0), axis=1)[near]
    return float(np.median(gaps)) if len(gaps) else 0.0
