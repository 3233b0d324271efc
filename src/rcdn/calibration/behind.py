"""Coded boards seen from behind: a print that shines through, or a plate with the same print, mirrored, on its back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration.arguments import check_boards
from rcdn.types import Board


def from_behind(boards: Sequence[Board]) -> list[Board]:
    """Boards of the image itself, from boards detected in its mirror image (x → width − 1 − x).

    Only boards whose codes were read there: in the image itself their labels then have the opposite orientation, as a
    front seen through the plate has. `T_cam_board` of such a board has z towards the camera. The plate is assumed to be
    thin. Plain boards are left out. Raises ConfigError for anything but a list of boards.
    """
    check_boards(boards)
    return [_turned_back(board) for board in boards if board.target is not None]


def _turned_back(board: Board) -> Board:
    return replace(board, xy=np.column_stack([board.image_size[0] - 1 - board.xy[:, 0], board.xy[:, 1]]))
