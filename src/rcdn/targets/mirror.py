"""Mirrored boards: a webcam's picture flipped for its user, or a print seen from behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.targets.read import Attempt, identified_straight
from rcdn.types import Array, Board, Target
from rcdn.types.arrays import Shaped


def identified_or_mirrored(
    grey: Shaped[Array, "h w"], board: Board, given: Target | None = None
) -> tuple[Attempt, Target | None]:
    """The attempt to decode the board's target, as `identified_straight`; if it has none, also the target that is
    decoded with certainty in the mirror image of the picture `grey` (H, W), else None. `given`: the target given by the
    user (None: unknown)."""
    attempt = identified_straight(grey, board, given)
    known = attempt.board.target is not None or attempt.contradicted
    return attempt, None if known else _mirrored_target(grey, board, given, attempt.mirrored(given))


def _mirrored_target(grey: Array, board: Board, given: Target | None, markers: bool) -> Target | None:
    """The target decoded in the mirror image, or None; `markers`: whether its squares may contain markers."""
    last = int(board.ij[:, 0].max())
    if board.pattern == "aprilgrid":
        last = last // 2 * 2 + 1  # a tag's first corner has an even label, counted from either side
    xy = board.xy * (-1, 1) + (grey.shape[1] - 1, 0)
    flipped = replace(board, xy=xy, ij=board.ij * (-1, 1) + (last, 0))
    return identified_straight(np.ascontiguousarray(grey[:, ::-1]), flipped, given, markers=markers).board.target
