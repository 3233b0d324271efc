"""Position of the printed markers of a ChArUco board in its squares: programs that draw on a raster shift them by
fractions of a pixel."""

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
"""sample positions in a square along each axis, squares; they include a margin of the adjacent squares"""
MANY = 400
"""largest number of squares that are used"""
BLUR = 0.05
"""initial guess of the blur, squares"""
SHARPEST, SOFTEST = 0.005, 0.3
"""limits of the blur, squares"""
PRIOR_SD = np.array([0.003, 0.003, 0.01, 1.0, 1.0, 0.01, 0.01])
"""prior standard deviations of a state: shift and side of printed markers, logs of the blurs, shift of a square by the
errors of its corners"""
BLURS, FRAME = slice(3, 5), slice(5, 7)
"""indices in a state of the blurs, and of the square's shift"""
SURE = 4.0
"""shrinkage factor: a shift of all markers of less than two standard deviations becomes 0"""
FARTHEST = 0.02
"""largest shift of a line of markers relative to the others, squares"""
STEPS = 8
"""largest number of Gauss–Newton steps"""
STEP = 1e-4
"""step of a numerical derivative"""
CLOSE = 1e-3
"""convergence threshold: after a smaller step the remaining change is lost in the rounding to `DIGITS`"""
DIGITS = 0.0005
"""squares; results are rounded to multiples of this, so that they don't depend on the last bits of sums"""


class Placement(NamedTuple):
    """Shifts of a board's markers from the centres of their squares: `across` (C,) along i, by column, `down` (R,)
    along j, by row; and the markers' `side`; squares."""

    across: Array
    down: Array
    side: float

    def shift(self, column: Array, row: Array) -> Real[Array, "... 2"]:
        """Shifts (..., 2) in the squares (column, row); beyond the known columns and rows, those of the outermost
        ones."""
        return np.stack(
            [line[np.clip(at, 0, len(line) - 1)] for line, at in ((self.across, column), (self.down, row))], axis=-1
        )


def placement(grey: Shaped[Array, "h w"], board: Board, target: Charuco) -> Placement | None:
    """The placement of a board's markers, by least squares together with levels and blur from all squares whose bits
    are known; None if the picture doesn't determine it.

    `grey` (H, W); the board's labels are positions on the target. The mean of all squares is fitted first, then the
    shift of each column and each row, weighted by the agreement of its squares.
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
    """(S, S) bool: samples from the middle of a marker's black border to the adjacent squares. The bits themselves are
    excluded: the rounding of their edges in print is larger than the information that they add about the marker's
    position."""
    x = np.abs(PLACES - 0.5)
    return np.asarray((np.maximum(x[:, None], x) > side * (0.5 - 0.5 / modules)) & (np.minimum(x[:, None], x) < 0.5))


def _shifts(squares: Array, cells: Real[Array, "k n n"], where: Array, state: Array) -> Real[Array, "k 2"]:
    """Shifts (K, 2) of the markers in addition to that of `state`, in squares (K, P) with `cells` (K, n, n)."""
    moved = state + STEP * np.eye(len(state))[[0, 1, 5, 6]]
    drawn = _drawn(cells, state, where)
    jacobian = [(_drawn(cells, one, where) - drawn) / STEP for one in moved]
    rows = np.stack([np.ones_like(drawn), drawn, *jacobian], axis=1)
    normal = rows @ rows.swapaxes(1, 2) + 1e-9 * np.eye(rows.shape[1])
    share = np.linalg.solve(normal, rows @ squares[:, :, None])[:, :, 0]
    contrast = np.where(np.abs(share[:, 1]) > 1e-9, share[:, 1], np.inf)
    return np.asarray((share[:, 2:4] - share[:, 4:6]) / contrast[:, None])


def _with_jacobian(cells: Array, where: Array, state: Array, square: Real[Array, " k"]) -> tuple[Array, Array]:
    """Model levels (K,) of a square and their Jacobian (7, K) with respect to the state, with the levels of black and
    white that fit `square` (K,) best."""
    values = np.array(
        [_levelled(square, _drawn(cells, one, where)) for one in (state, *(state + STEP * np.eye(len(state))))]
    )
    return values[0], (values[1:] - values[0]) / STEP


def _by_line(own: Real[Array, " k"], line: Real[Array, " k"], common: float) -> Array:
    """Shifts by line (column or row), 0 to the last: the shift `common` to all plus the mean of the additional shifts
    `own` (K,) of the squares in each `line` (K,); both are shrunk according to the scatter of the squares
    (James and Stein)."""
    count = np.bincount(line)
    known, mean = count > 0, np.bincount(line, own) / np.maximum(count, 1)
    within = np.square(own - mean[line]).sum() / max(len(own) - known.sum(), 1)
    certain = max(0.0, 1 - SURE * within / len(own) / (common**2 + 1e-12))
    between = max(np.square(mean[known]).mean() - (within / count[known]).mean(), 0.0)
    weight = between / (between + within / np.maximum(count, 1) + 1e-12) * (len(own) > known.sum())
    return _rounded(certain * common + (weight * mean).clip(-FARTHEST, FARTHEST))


def _fitted(
    mean: Array, cells: Real[Array, "n n"], where: Array, side: float, aspect: float
) -> Real[Array, " k"] | None:
    """The state that fits the mean (K,) of squares with markers of `cells` (n, n), 1 white, and nominal side `side`:
    shift (2) and side of the marker, logs of the blurs (2), shift of the square itself (2). None where the fit
    fails."""
    expected = np.array([0, 0, side, *np.log(BLUR * np.array([aspect**-0.5, aspect**0.5])), 0, 0])
    state = expected.copy()
    for _ in range(STEPS):
        values, jacobian = _with_jacobian(cells, where, state, mean)
        off = mean - values
        stiff = off.var() / PRIOR_SD**2
        normal = jacobian @ jacobian.T + np.diag(stiff + 1e-9)
        step = np.linalg.solve(normal, jacobian @ off + stiff * (expected - state)).clip(-0.3, 0.3)
        state = state + step
        state[BLURS] = np.clip(state[BLURS], np.log(SHARPEST), np.log(SOFTEST))
        if np.abs(step).max() < CLOSE:
            break
    usable = np.isfinite(state).all() and (np.abs(state - expected) <= 4 * PRIOR_SD).all()
    return state if usable else None


def _levelled(mean: Array, drawn: Array) -> Array:
    """`drawn` with the levels of black and white that fit `mean` best."""
    d, m = drawn - drawn.mean(), mean - mean.mean()
    return np.asarray(mean.mean() + d * ((d * m).sum() / max((d * d).sum(), 1e-12)))


def _drawn(cells: Real[Array, "... n n"], state: Array, where: Bool[Array, "s s"]) -> Real[Array, "... p"]:
    """The levels (..., P), at the samples `where` (S, S), of a square with a marker of `cells` (..., n, n), black 0,
    white 1, between dark squares."""
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
    """Weights (S, n + 1) of the cells between `edges` (n,), and of those beyond the outermost ones, at the samples of a
    square."""
    steps = 0.5 * (1 + erf((PLACES[:, None] - edges) / (np.sqrt(2) * np.exp(log_blur))))
    return np.asarray(-np.diff(steps, axis=1, prepend=1.0, append=0.0))
