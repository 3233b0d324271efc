"""Numbered corners of one board, picture by picture: what other programs' solvers take (docs/adapters.md)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.types import AprilGrid, Array, Board, Charuco, Checkerboard, Printed


class View(NamedTuple):
    """A board in a picture: `picture`, the picture's number from 0; `ids` (N,), the corners' numbers, rising; `xy` (N, 2) px;
    `points` (N, 3) m, where they lie on the board (z is 0)."""

    picture: int
    ids: Array
    xy: Array
    points: Array


def views(pictures: Iterable[Iterable[Board]], printed: Printed, several_cameras: bool = False) -> list[View]:
    """The views of the board `printed` among the boards of each of `pictures`; a picture without it has none.

    Corners are numbered as `printed.ids` has them, and `printed.points()` in this order. Of several such boards in a picture the one with most
    corners is taken. A coded board counts if that very target was read (`DetectorConfig(target=printed.target)`), in parts, too. A plain one counts
    if it spans all columns and rows: a part of it could lie in several places. With `several_cameras` it must also have a `unique` orientation,
    since each camera would number other boards from a corner of its own. Raises ConfigError for targets other than Checkerboard, Charuco, AprilGrid.
    """
    if not isinstance(printed.target, (Checkerboard, Charuco, AprilGrid)):
        raise ConfigError(
            f"printed.target must be a Checkerboard, a Charuco or an AprilGrid, not {shown(printed.target)}"
        )
    found = []
    for number, boards in enumerate(pictures):
        numbered = [_numbered(board, printed.target, several_cameras) for board in boards]
        ids, xy = max((n for n in numbered if n is not None), key=lambda n: len(n[0]), default=(None, None))
        if ids is not None and xy is not None:
            found.append(View(number, ids, xy, np.pad(printed.points(ids), ((0, 0), (0, 1)))))
    return found


def _numbered(
    board: Board, target: Checkerboard | Charuco | AprilGrid, several_cameras: bool
) -> tuple[Array, Array] | None:
    """The numbers (N,) of a board's corners on the target, rising, and their positions (N, 2); None if it isn't a view of it."""
    if not isinstance(target, Checkerboard):
        if board.ids is None or board.target != target:
            return None
        order = np.argsort(board.ids)
        return board.ids[order], board.xy[order]
    plain = board.pattern == "checker" and board.target is None
    grid = board.grid_of((target.columns, target.rows)) if plain else None
    if grid is None or (several_cameras and board.orientation != "unique"):
        return None
    xy = grid.reshape(-1, 2)
    ids = np.flatnonzero(np.isfinite(xy[:, 0]))
    return ids, xy[ids]
