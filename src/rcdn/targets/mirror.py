"""Boards seen in a mirror: a webcam's picture flipped for its user, a print seen from behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.targets.read import identified
from rcdn.types import Array, Board, Target
from rcdn.types.arrays import Shaped


def mirrored_target(grey: Shaped[Array, "h w"], board: Board, told: Target | None = None) -> Target | None:
    """The target that the codes of a board are certain to be in the mirror image of its picture `grey` (H, W); None if none is.

    `told`: the only target that it may be.
    """
    last = int(board.ij[:, 0].max())
    if board.pattern == "aprilgrid":
        last = last // 2 * 2 + 1  # tags begin at even labels from either side
    xy = board.xy * (-1, 1) + (grey.shape[1] - 1, 0)
    flipped = replace(board, xy=xy, ij=board.ij * (-1, 1) + (last, 0))
    return identified(np.ascontiguousarray(grey[:, ::-1]), flipped, told).target
