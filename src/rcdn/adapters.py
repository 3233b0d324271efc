"""Numbered corners of one board, picture by picture, as input for other programs' solvers (docs/adapters.md)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.geometry.part import grid_on, origin_dark
from rcdn.geometry.rules import CHECKER
from rcdn.types import AprilGrid, Array, Board, Charuco, Checkerboard, Printed


class View(NamedTuple):
    """A board in a picture: `picture`, the picture's number from 0; `ids` (N,), the corners' numbers in ascending
    order; `xy` (N, 2) px; `points` (N, 3) m, the corners' positions on the board (z is 0)."""

    picture: int
    ids: Array
    xy: Array
    points: Array


def views(pictures: Iterable[Iterable[Board]], printed: Printed, several_cameras: bool = False) -> list[View]:
    """The views of the board `printed` among the boards detected in each of `pictures`; pictures without it have no
    view.

    Corners are numbered as in `printed.ids`, and `printed.points()` is in the same order. If a picture shows several
    such boards, the one with the most corners is used. A coded board is accepted if exactly this target was read
    (`DetectorConfig(target=printed.target)`), even if only a part of it is visible. A plain board is accepted if it
    spans all columns and rows, or if the picture's border cut it so that it has one place on the whole board. With
    `several_cameras` its colours must also tell which corner is the first, because otherwise each camera might count
    from a different one. Raises ConfigError for targets other than Checkerboard, Charuco and AprilGrid.
    """
    if not isinstance(printed.target, (Checkerboard, Charuco, AprilGrid)):
        raise ConfigError(
            f"printed.target must be a Checkerboard, a Charuco or an AprilGrid, not {shown(printed.target)}"
        )
    found, every, target = [], [list(boards) for boards in pictures], printed.target
    size = (target.columns, target.rows or 0)
    dark = origin_dark((b.origin_dark for boards in every for b in boards if b.size == size), size)
    for number, boards in enumerate(every):
        numbered = [_numbered(board, target, dark, several_cameras) for board in boards]
        ids, xy = max((n for n in numbered if n is not None), key=lambda n: len(n[0]), default=(None, None))
        if ids is not None and xy is not None:
            found.append(View(number, ids, xy, np.pad(printed.points(ids), ((0, 0), (0, 1)))))
    return found


def _numbered(
    board: Board, target: Checkerboard | Charuco | AprilGrid, dark: bool | None, several_cameras: bool
) -> tuple[Array, Array] | None:
    """Numbers (N,) of a board's corners on the target, in ascending order, and their positions (N, 2), px; None if the
    board is not a view of the target."""
    if not isinstance(target, Checkerboard):
        if board.ids is None or board.target != target:
            return None
        order = np.argsort(board.ids)
        return board.ids[order], board.xy[order]
    plain = board.pattern == "checker" and board.target is None
    size = (target.columns, target.rows)
    grid = grid_on(board, size, dark) if plain else None
    sure = board.orientation == "unique" or board.origin_dark is not None
    if grid is None or (several_cameras and not (sure and CHECKER.orientation(*size) == "unique")):
        return None
    xy = grid.reshape(-1, 2)
    ids = np.flatnonzero(np.isfinite(xy[:, 0]))
    return ids, xy[ids]
