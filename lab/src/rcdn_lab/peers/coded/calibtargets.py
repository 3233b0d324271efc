"""calib-targets: ChArUco boards and PuzzleBoards. It is given the board, except for the position of a PuzzleBoard's
part on the code.

It does not support legacy boards, a first id other than 0, and AprilGrids; for inverted grey levels it is given the
negative.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rcdn.targets.layout import odd_markers
from rcdn.types import Array
from rcdn.types.target import PUZZLE, Charuco, PuzzleBoard, Target
from rcdn_lab.peers.base import not_installed, version_of
from rcdn_lab.peers.coded.base import CodedPeer, Labelled, Read, board_size, boards_of

ORIGIN = 168
"""columns and rows by which the origin of its PuzzleBoard precedes that of the authors"""
SIDE = 50
"""squares of a PuzzleBoard that it is given, because the actual number is unknown"""


def _reads(target: Target) -> bool:
    if isinstance(target, Charuco):
        return not target.first_id and odd_markers(target)
    return isinstance(target, PuzzleBoard)


def _missing() -> str | None:
    return not_installed("calib_targets")


def read(image: Array, target: Target) -> list[Labelled]:
    """The board's ids; [] if it finds none, which it reports by an exception, and for targets that it does not
    support."""
    if not _reads(target):
        return []
    try:
        return _charuco(image, target) if isinstance(target, Charuco) else _puzzleboard(image)
    except (RuntimeError, ValueError):
        return []


def _charuco(image: Array, target: Charuco) -> list[Labelled]:
    import calib_targets

    columns, rows = board_size(target)
    board = calib_targets.CharucoBoardSpec(rows, columns, 1.0, target.marker, target.dictionary)
    grey = np.ascontiguousarray(255 - image if target.inverted else image)
    found = calib_targets.detect_charuco(grey, params=calib_targets.CharucoParams(board))
    return boards_of([int(c.id) for c in found.corners], [_position(c) for c in found.corners])


def _puzzleboard(image: Array) -> list[Labelled]:
    import calib_targets

    parameters = calib_targets.default_puzzleboard_params(SIDE, SIDE)
    found = calib_targets.detect_puzzleboard(np.ascontiguousarray(image), params=parameters)
    ids = [PUZZLE * ((c.grid.v - ORIGIN) % PUZZLE) + (c.grid.u - ORIGIN) % PUZZLE for c in found.corners]
    return boards_of(ids, [_position(c) for c in found.corners])


def _position(corner: Any) -> Array:
    return np.array([corner.position[0], corner.position[1]], float)


def _load() -> Read:
    return read


CALIB_TARGETS = CodedPeer("calib-targets", _reads, _missing, lambda: version_of("calib-targets"), _load)
