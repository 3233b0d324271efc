"""Boards with codes that a camera sees from behind: a print that shines through, or a plate with the same print, mirrored, on its back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rcdn.types import Board


def from_behind(boards: Sequence[Board]) -> list[Board]:
    """Boards of the picture itself, from those that were found in its mirror image (x → width − 1 − x).

    Only boards whose codes were read in it: their labels then run the other way round in the picture, which is how a front that lies on
    the far side of the plate looks. `T_cam_board` of such a board has z towards the camera. The plate is taken to be thin.
    """
    return [_turned_back(board) for board in boards if board.target is not None]


def _turned_back(board: Board) -> Board:
    return replace(board, xy=np.column_stack([board.image_size[0] - 1 - board.xy[:, 0], board.xy[:, 1]]))
