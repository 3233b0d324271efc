"""Where the markers of a ChArUco board stand in its squares, as printed: programs that draw on a raster put them off by
parts of a dot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rcdn.geometry.elementary import erf
from rcdn.targets.dictionaries import marker_bits
from rcdn.targets.layout import markers_in
from rcdn.targets.rectify import aspect_of, grid_with_ring, squares_in_perspective, whole_squares
from rcdn.types import Array, Board, Charuco
from rcdn.types.arrays import Bool, Real, Shaped

PLACES = (np.arange(-4, 36) + 0.5) / 32
"""where a square is sampled along each axis, squares; a little of those beside it is seen"""
MANY = 400
"""squares that are enough"""
BLUR = 0.05
"""squares, to begin with"""
SHARPEST, SOFTEST = 0.005, 0.3
USUAL = np.array([0.003, 0.003, 0.01, 1.0, 1.0, 0.01, 0.01])
"""standard deviations of a state: shift and side of printed markers, logs of the blurs, shift of a square by the errors
of its corners"""
BLURS, FRAME = slice(3, 5), slice(5, 7)
"""where a state has the blurs, and the square's shift"""
SURE = 4.0
"""a shift of all markers of less than two standard deviations is none"""
FARTHEST = 0.02
"""squares by which a line of markers is off the others at most"""
STEPS = 8
"""Gauss–Newton steps"""
STEP = 1e-4
"""for a derivative"""
CLOSE = 1e-3
"""a smaller step is the last: what is left of it is less than is rounded away"""
DIGITS = 0.0005
"""squares to which the result is rounded, so that the last bits of sums don't matter"""


class Placement(NamedTuple):
    """How a board's markers stand off the middles of their squares: `across` (C,) along i, by column, `down` (R,) along
    j, by row, and their `side`; squares."""

    across: Array
    down: Array
    side: float

    def shift(self, column: Array, row: Array) -> Real[Array, "... 2"]:
        """(..., 2) of the squares (column, row); that of the outermost that are known beyond them."""
        return np.stack(
            [line[np.clip(at, 0, len(line) - 1)] for line, at in ((self.across, column), (self.down, row))], axis=-1
        )


def placement(grey: Shaped[Array, "h w"], board: Board, target: Charuco) -> Placement | None:
    """By least squares from all squares with markers whose bits are known, beside levels and blur; None where the
    picture doesn't tell.

    `grey` (H, W); the board's labels are places on the target. The mean of all squares tells most, then each column and
    each row as far as its squares agree.
    """
    grid, found = grid_with_ring(board)
    row, column = np.nonzero(whole_squares(found))
    place = np.stack([column, row], axis=1) + board.ij.min(axis=0)
    bits = marker_bits(target.dictionary)
    marker, marked = markers_in(target, place)
    some = np.flatnonzero(marked & (marker >= 0) & (marker < len(bits)))
    some = some[:: len(some) // MANY + 1]
    squares = squares_in_perspective(grey, grid, row[some], column[some], PLACES)
    seen = np.isfinite(squares).all(axis=(1, 2))
    if not seen.any():
        return None
    place, cells = place[some[seen]], np.pad(bits[marker[some[seen]]], ((0, 0), (1, 1), (1, 1))).astype(float)
    where = _outside_bits(cells.shape[1], target.marker)
    squares = squares[seen][:, where]
    state = _fitted(squares.mean(axis=0), cells.mean(axis=0), where, target.marker, aspect_of(grid))
    if state is None:
        return None
    own = _shifts(squares, cells, where, state)
    across, down = (_by_line(own[:, k], place[:, k], float(state[k] - state[FRAME][k])) for k in (0, 1))
    return Placement(across, down, float(_rounded(state[2])))


def _rounded(value: Array) -> Array:
    return np.asarray(DIGITS * np.round(value / DIGITS))


def _outside_bits(modules: int, side: float) -> Bool[Array, "s s"]:
    """(S, S) bool: places from the middle of a marker's black border to the squares beside its own. What its bits say
    of its place is less than how they were rounded."""
    x = np.abs(PLACES - 0.5)
    return np.asarray((np.maximum(x[:, None], x) > side * (0.5 - 0.5 / modules)) & (np.minimum(x[:, None], x) < 0.5))


def _shifts(squares: Array, cells: Real[Array, "k n n"], where: Array, state: Array) -> Real[Array, "k 2"]:
    """By how much more (K, 2) than `state` says the markers of squares (K, P) with `cells` (K, n, n) stand off their
    middles."""
    moved = state + STEP * np.eye(len(state))[[0, 1, 5, 6]]
    drawn = _drawn(cells, state, where)
    jacobian = [(_drawn(cells, one, where) - drawn) / STEP for one in moved]
    rows = np.stack([np.ones_like(drawn), drawn, *jacobian], axis=1)
    normal = rows @ rows.swapaxes(1, 2) + 1e-9 * np.eye(rows.shape[1])
    share = np.linalg.solve(normal, rows @ squares[:, :, None])[:, :, 0]
    contrast = np.where(np.abs(share[:, 1]) > 1e-9, share[:, 1], np.inf)
    return np.asarray((share[:, 2:4] - share[:, 4:6]) / contrast[:, None])


def _with_jacobian(cells: Array, where: Array, state: Array, square: Real[Array, " k"]) -> tuple[Array, Array]:
    """Levels (K,) of a square, and their derivatives (7, K) by the state, with the black and the white that are nearest
    to `square` (K,)."""
    values = np.array(
        [_levelled(square, _drawn(cells, one, where)) for one in (state, *(state + STEP * np.eye(len(state))))]
    )
    return values[0], (values[1:] - values[0]) / STEP


def _by_line(own: Real[Array, " k"], line: Real[Array, " k"], usual: float) -> Array:
    """Shifts by line (column or row), 0 to the last: `usual`, and the mean of what the squares in the `line` (K,) say
    besides, `own` (K,); each as far as it exceeds what the scatter of squares makes of none (James and Stein)."""
    count = np.bincount(line)
    known, mean = count > 0, np.bincount(line, own) / np.maximum(count, 1)
    within = np.square(own - mean[line]).sum() / max(len(own) - known.sum(), 1)
    certain = max(0.0, 1 - SURE * within / len(own) / (usual**2 + 1e-12))
    between = max(np.square(mean[known]).mean() - (within / count[known]).mean(), 0.0)
    weight = between / (between + within / np.maximum(count, 1) + 1e-12) * (len(own) > known.sum())
    return _rounded(certain * usual + (weight * mean).clip(-FARTHEST, FARTHEST))


def _fitted(
    mean: Array, cells: Real[Array, "n n"], where: Array, side: float, aspect: float
) -> Real[Array, " k"] | None:
    """The state under which the mean (K,) of squares shows markers of `cells` (n, n), 1 white, whose side should be
    `side`: shift (2) and side of the marker, logs of the blurs (2), shift of the square itself (2). None where the fit
    fails."""
    usual = np.array([0, 0, side, *np.log(BLUR * np.array([aspect**-0.5, aspect**0.5])), 0, 0])
    state = usual.copy()
    for _ in range(STEPS):
        values, jacobian = _with_jacobian(cells, where, state, mean)
        off = mean - values
        stiff = off.var() / USUAL**2
        normal = jacobian @ jacobian.T + np.diag(stiff + 1e-9)
        step = np.linalg.solve(normal, jacobian @ off + stiff * (usual - state)).clip(-0.3, 0.3)
        state = state + step
        state[BLURS] = np.clip(state[BLURS], np.log(SHARPEST), np.log(SOFTEST))
        if np.abs(step).max() < CLOSE:
            break
    usable = np.isfinite(state).all() and (np.abs(state - usual) <= 4 * USUAL).all()
    return state if usable else None


def _levelled(mean: Array, drawn: Array) -> Array:
    """`drawn` with the black and the white that are nearest to `mean`."""
    d, m = drawn - drawn.mean(), mean - mean.mean()
    return np.asarray(mean.mean() + d * ((d * m).sum() / max((d * d).sum(), 1e-12)))


def _drawn(cells: Real[Array, "... n n"], state: Array, where: Bool[Array, "s s"]) -> Real[Array, "... p"]:
    """The levels (..., P) `where` (S, S) a square is looked at that has a marker of `cells` (..., n, n), black 0, white
    1, in dark squares."""
    count = cells.shape[-1]
    values = np.zeros((*cells.shape[:-2], count + 4, count + 4))
    values[..., 1:-1, 1:-1] = 1.0
    values[..., 2:-2, 2:-2] = cells
    values[..., [0, 0, -1, -1], [0, -1, 0, -1]] = 1.0
    lines = np.arange(count + 1) / count - 0.5
    across, down = (
        _shares(np.concatenate([[state[5 + k]], 0.5 + state[k] + state[2] * lines, [1 + state[5 + k]]]), state[3 + k])
        for k in (0, 1)
    )
    return np.asarray((down @ values @ across.T)[..., where])


def _shares(edges: Real[Array, " n"], log_blur: float) -> Array:
    """What each cell between `edges` (n,), and beyond, gives to places in a square, (S, n + 1)."""
    steps = 0.5 * (1 + erf((PLACES[:, None] - edges) / (np.sqrt(2) * np.exp(log_blur))))
    return np.asarray(-np.diff(steps, axis=1, prepend=1.0, append=0.0))
