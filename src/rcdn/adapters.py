"""Numbered corners of one board, picture by picture, as input for other programs' solvers (docs/adapters.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rcdn.errors import ConfigError, shown
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
    (`DetectorConfig(target=printed.target)`; `legacy` may differ), even if only a part of it is visible. A plain board
    is accepted if it spans all columns and rows, since a part of it could lie in several places. With `several_cameras`
    its orientation must also be `unique`, because otherwise each camera might count from a different corner. Raises
    ConfigError for targets other than Checkerboard, Charuco and AprilGrid.
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
    """Numbers (N,) of a board's corners on the target, in ascending order, and their positions (N, 2), px; None if the
    board is not a view of the target."""
    if not isinstance(target, Checkerboard):
        known = board.target
        if isinstance(known, Charuco) and isinstance(target, Charuco):
            known = replace(known, legacy=target.legacy)  # the corners of both layouts have the same numbers and places
        if board.ids is None or known != target:
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
