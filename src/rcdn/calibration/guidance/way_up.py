"""Which way up the board is to be held.

Errors of a print belong to the board, those of a lens to the frame. Where the board always stands the same way up,
some of the former look like the latter: a spacing that grows along the board like a lens that magnifies one side. With
the board turned by half they have the opposite sign. (Orthogonal roll angles serve the same in photogrammetry: Luhmann
et al., Close-Range Photogrammetry and 3D Imaging.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rcdn.calibration.labels import Size
from rcdn.calibration.next_view import NextView
from rcdn.geometry.order import rightward
from rcdn.geometry.part import labels_of, tells_its_way
from rcdn.types import Array, Board, Plane, Pose

LEAD = 2
"""number of pictures by which one way up leads, after which the other one is wanted"""
SLANTED = 0.8
"""cosine of an axis with the picture's rows below which a board lies aslant"""
TURN = "Turn the board upside down."


def upright(board: Board, size: Size | None) -> bool | None:
    """Whether a `board` of `size` (columns, rows) is the right way up: the first index of its labels grows to the right
    in the picture, or the second one does where the board stands on its side; None if its place on the whole board is
    unknown, it lies aslant, or the print looks the same after half a turn."""
    ij = board.ij if board.target is not None else _labels(board, size)
    if ij is None:
        return None
    across = [rightward(ij, board.xy), rightward(ij[:, ::-1], board.xy)]
    level = max(across, key=abs)
    return level > 0 if abs(level) > SLANTED else None


def _labels(board: Board, size: Size | None) -> Array | None:
    if size is None or board.pattern != "checker" or not tells_its_way(board, size):
        return None
    return labels_of(board, size, True)


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
