"""Which way up the board is to be held.

Errors of a print belong to the board, those of a lens to the frame. Where the board always stands the same way up,
some of the former look like the latter: a spacing that grows along the board like a lens that magnifies one side. With
the board turned by half they have the opposite sign. (Orthogonal roll angles serve the same in photogrammetry: Luhmann
et al., Close-Range Photogrammetry and 3D Imaging, section 7.3.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rcdn.calibration.labels import Size
from rcdn.calibration.next_view import NextView
from rcdn.geometry.order import rightward
from rcdn.geometry.part import labels_of
from rcdn.geometry.rules import CHECKER
from rcdn.types import Board, Plane, Pose

LEAD = 2
"""number of pictures by which one way up leads, after which the other one is wanted"""
TURN = "Turn the board upside down."


def upright(board: Board, size: Size | None) -> bool | None:
    """Whether the columns of a `board` of `size` (columns, rows) run to the right in the picture; None if its place on
    the whole board is unknown, or the print looks the same after half a turn."""
    if board.target is not None:
        return rightward(board.ij, board.xy) > 0
    if size is None or board.pattern != "checker" or not _unique(board, size):
        return None
    ij = labels_of(board, size, True)
    return None if ij is None else rightward(ij, board.xy) > 0


def _unique(board: Board, size: Size) -> bool:
    known = board.origin_dark is not None or board.orientation == "unique"
    return known and CHECKER.orientation(*size) == "unique"


def next_way(ways: Iterable[bool | None]) -> tuple[bool | None, bool]:
    """Which way up the next picture is wanted (None: either) after pictures of these `ways`, as `upright` says, and
    whether the board must be turned for it."""
    known = [way for way in ways if way is not None]
    if not known:
        return None, False
    last = known[-1]
    turn = known.count(last) >= known.count(not last) + LEAD
    return last != turn, turn


def held_up(view: NextView, way: bool | None, plane: Plane, spacing: float) -> NextView:
    """The wanted `view` with the board the other way up, if `way` is False; `spacing` m of its labels' `plane`."""
    if way is not False:
        return replace(view, upright=way)
    middle = np.append(plane.points((np.array(view.size) - 1) / 2) * spacing, 0)
    T, half = view.pose.T_cam_board.copy(), np.diag([-1.0, -1.0, 1.0])
    T[:3, 3] += T[:3, :3] @ (middle - half @ middle)
    T[:3, :3] = T[:3, :3] @ half
    return replace(view, pose=Pose(T), outline=np.roll(view.outline, 2, axis=0), upright=False)
