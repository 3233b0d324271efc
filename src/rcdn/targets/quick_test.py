"""A quick test of a board for codes before any is decoded: the squares around some of its corners, from few samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from rcdn.geometry.median import median
from rcdn.types import Array, Board
from rcdn.types.arrays import Bool, Real, Shaped

SAMPLES = 8
"""samples along a square's side"""
MOST_CORNERS = 32
"""largest number of corners around which squares are sampled"""
PLAIN = 0.15
"""standard deviation inside squares, share of the contrast, below which they contain no markers"""
FAINT = 0.12
"""difference of grey level between circles on edges and the mean of the adjacent squares, share of their contrast,
below which there are no circles"""
LOOSER = 0.8
"""factor on these thresholds in the quick test, which samples only few squares"""
FEW = 8
"""least number of edges from which the effect of bent edges is estimated"""
REACH = 30000
"""px: OpenCV's `remap` takes no larger pictures"""


@dataclass(frozen=True, eq=False)
class CornerSamples:
    """Samples around K corners: `squares` (K, 2, 2, S, S), grey levels of the four squares around each, row by row;
    `odd` (K,) bool: whether the upper left one has the other colour; `edges` (4, K): grey level at the middle of the
    edges from the corner, less the mean of both sides, ÷ the first side's contrast to the other, corrected for the
    effects of bent edges and ink spread; NaN where there is no contrast."""

    squares: Array
    odd: Array
    edges: Array

    @property
    def may_carry_codes(self) -> bool:
        """Whether there may be markers in squares of one colour, or circles on the edges."""
        known = np.abs(self.edges[np.isfinite(self.edges)])
        level = median(known) if len(known) else 0.0
        return level >= LOOSER * FAINT or self._spread_of_one_colour > (LOOSER * PLAIN) ** 2

    @property
    def _spread_of_one_colour(self) -> float:
        """Difference of the variances inside squares of the two colours, share of the squared contrast."""
        a, b = np.indices((2, 2))
        colour = ((a + b)[None] + self.odd[:, None, None]) % 2 == 1
        spread = self.squares[..., 1:-1, 1:-1].var(axis=(3, 4))
        rim = self.squares[..., :: SAMPLES - 1, :].mean(axis=(3, 4))
        dark, bright = (tuple(median(v[c]) for v in (spread, rim)) for c in (colour, ~colour))
        return abs(dark[0] - bright[0]) / max((dark[1] - bright[1]) ** 2, 1e-6)


def sample_corners(grey: Shaped[Array, "h w"], board: Board) -> CornerSamples | None:
    """Samples of a board of squares in `grey` (H, W); None if no corner has all its eight neighbours."""
    grid = board.grid()
    if min(grid.shape[:2]) < 3:
        return None
    around = np.lib.stride_tricks.sliding_window_view(grid, (3, 3), axis=(0, 1))  # (R − 2, C − 2, 2, 3, 3)
    row, column = np.nonzero(np.isfinite(around).all(axis=(2, 3, 4)))
    if not len(row):
        return None
    some = np.linspace(0, len(row) - 1, min(len(row), MOST_CORNERS)).astype(int)
    row, column = row[some], column[some]
    values = _sampled(grey, _places() @ around[row, column].reshape(len(row), 2, 9).swapaxes(1, 2))
    if values is None:
        return None
    squares = values[:, : 4 * SAMPLES**2].reshape(-1, 2, 2, SAMPLES, SAMPLES)
    circle = values[:, 4 * SAMPLES**2 :].reshape(-1, 4, 11)
    one, other = circle[..., 9], circle[..., 10]
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = ((circle[..., :9].mean(axis=2) - (one + other) / 2) / (one - other)).T
    return CornerSamples(squares, (row + column) % 2 == 1, _unbent(edges, row, column))


def _unbent(values: Array, row: Array, column: Array) -> Real[Array, "j k"]:
    """Values (J, K) at the grid positions `row`, `column` (K,), less the least-squares fit of a plane (the effect of
    bent edges) and a checker pattern (that of ink spread) to each of the J rows; NaN where a value is invalid."""
    known = np.abs(values) < 1.5
    causes = np.stack([np.ones(len(row)), row, column, (row + column) % 2], axis=1)
    out = np.where(known, values, np.nan)
    for edge, seen in zip(out, known, strict=True):
        if seen.sum() >= FEW:
            edge -= causes @ np.linalg.lstsq(causes[seen], edge[seen], rcond=None)[0]
    return out


def _sampled(grey: Array, xy: Real[Array, "k p 2"]) -> Array | None:
    """Grey levels at `xy` (K, P, 2) px, (K, P) float32, with the border pixels repeated outside the picture; None if
    they span a larger part of the picture than OpenCV can sample."""
    limits = np.array(grey.shape[::-1]) - 1
    x, y = xy[..., 0], xy[..., 1]  # separately: NumPy is slow for both together
    low = np.clip(np.floor((x.min(), y.min())) - 1, 0, limits).astype(int)
    high = np.clip(np.ceil((x.max(), y.max())) + 2, low + 1, limits + 1).astype(int)
    if (high - low).max() > REACH:
        return None
    at = (xy - low).astype(np.float32)
    part = grey[low[1] : high[1], low[0] : high[0]]
    seen = cv2.remap(part, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen, np.float32)


@lru_cache
def _places() -> Real[Array, "p 9"]:
    """Positions of the samples as weights (P, 9) of a corner and its eight neighbours, row by row: those of the four
    squares; and for each of the four edges nine at its middle and one on either side."""
    nodes = np.eye(9).reshape(3, 3, 9)
    step = (np.arange(SAMPLES) + 0.5) / SAMPLES
    v, u = (a.reshape(-1, 1) for a in np.meshgrid(step, step, indexing="ij"))
    squares = []
    for r in (0, 1):
        for c in (0, 1):
            upper, lower = ((1 - u) * nodes[k, c] + u * nodes[k, c + 1] for k in (r, r + 1))
            squares.append((1 - v) * upper + v * lower)
    edges = []
    for turns in range(4):
        turned = np.rot90(nodes, turns)
        middle = (turned[1, 1] + turned[1, 2]) / 2
        above, below = ((turned[k, 1] + turned[k, 2]) / 2 for k in (0, 2))
        along, across = turned[1, 2] - turned[1, 1], (below - above) / 2
        edges += [middle + a * along + b * across for a in (-0.09, 0.0, 0.09) for b in (-0.09, 0.0, 0.09)]
        edges += [middle + 0.35 * (side - middle) for side in (above, below)]
    return np.concatenate([*squares, np.array(edges)])


def marked_squares(squares: Real[Array, "r c s s"], inner: Bool[Array, "r c"]) -> Array | None:
    """The `squares` (R, C, S, S) of the colour that contains markers, (R, C) bool; None if the two colours do not
    differ enough in variance. Only `inner` (R, C) squares are evaluated."""
    row, column = np.indices(inner.shape)
    middle = squares[:, :, 1:-1, 1:-1]
    level, spread = middle.mean(axis=(2, 3)), middle.var(axis=(2, 3))
    colours = [(row + column) % 2 == k for k in (0, 1)]
    known = [c & inner & np.isfinite(level) for c in colours]
    if min(k.sum() for k in known) < 1:
        return None
    rim = np.concatenate(
        [squares[:, :, :1, :].reshape(*inner.shape, -1), squares[:, :, -1:, :].reshape(*inner.shape, -1)], axis=2
    ).mean(axis=2)
    contrast = abs(median(rim[known[0]]) - median(rim[known[1]]))
    noise = [median(spread[k]) for k in known]
    more = int(np.argmax(noise))
    if noise[more] - noise[1 - more] < (PLAIN * contrast) ** 2:
        return None
    return np.asarray(colours[more])
