"""Drop-only validation: a corner that doesn't fit goes; none is ever renamed."""

from __future__ import annotations

import numpy as np

from rcdn.boards.graph import Label
from rcdn.boards.grow import STEPS
from rcdn.boards.local import Grid

RESIDUAL = 0.2
"""largest distance from the neighbours' prediction, share of the pitch"""
RESIDUAL_LOOSE = 0.3
"""the same where the prediction extrapolates from few corners"""


def prune(grid: Grid) -> None:
    """Drop misfits, worst first, then what no longer hangs together. In place."""
    for _ in range(len(grid)):
        worst, spot = _worst(grid)
        if spot is None or worst <= 1:
            break
        del grid.at[spot]
    _drop_loose(grid)
    _keep_largest(grid)


def _worst(grid: Grid) -> tuple[float, Label | None]:
    """The corner furthest beyond its limit: (distance ÷ limit, spot). An unpredictable corner counts as 2."""
    worst: tuple[float, Label | None] = (0.0, None)
    for spot, corner in sorted(grid.at.items()):
        guess = grid.predict(spot)
        if guess is None:
            excess = 2.0
        else:
            limit = RESIDUAL if _inner(grid, spot) else RESIDUAL_LOOSE
            excess = float(np.linalg.norm(grid.xy[corner] - guess.xy)) / (limit * max(guess.pitch, 1e-9))
        if excess > worst[0]:
            worst = (excess, spot)
    return worst


def _inner(grid: Grid, spot: Label) -> bool:
    """Neighbours on both sides, along at least one of the two directions."""
    u, v = spot
    return any((u - d, v - e) in grid.at and (u + d, v + e) in grid.at for d, e in ((1, 0), (0, 1)))


def _drop_loose(grid: Grid) -> None:
    """Every corner belongs to a whole cell."""
    while True:
        cells = {(u, v) for u, v in grid.at if all(s in grid.at for s in ((u + 1, v), (u, v + 1), (u + 1, v + 1)))}
        held = {(u + d, v + e) for u, v in cells for d in (0, 1) for e in (0, 1)}
        loose = set(grid.at) - held
        if not loose:
            return
        for spot in loose:
            del grid.at[spot]


def _keep_largest(grid: Grid) -> None:
    """Of parts that no edge joins, the largest."""
    left, parts = set(grid.at), []
    while left:
        stack, part = [min(left)], set()
        while stack:
            u, v = stack.pop()
            if (u, v) not in left:
                continue
            left.discard((u, v))
            part.add((u, v))
            stack += [(u + d, v + e) for d, e in STEPS]
        parts.append(part)
    for part in sorted(parts, key=lambda p: (-len(p), min(p)))[1:]:
        for spot in part:
            del grid.at[spot]


def cell_count(grid: Grid) -> int:
    """Whole cells of a grid."""
    return sum(all(s in grid.at for s in ((u + 1, v), (u, v + 1), (u + 1, v + 1))) for u, v in grid.at)
