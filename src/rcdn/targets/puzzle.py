"""Reads PuzzleBoards (Stelldinger, Schönherr, Biermann 2024, arXiv 2409.20127): the circle at the middle of every edge
is one bit, white or black.

Edges along y carry code 1, whose 3 rows repeat along y and 167 columns along x; edges along x carry code 2, with x and
y exchanged. All visible circles contribute evidence for each of the 501 × 501 positions in four orientations; see
`charuco` for the evidence and its threshold.
"""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.targets.quick_test import FAINT
from rcdn.targets.reading import Reading
from rcdn.types import Array, PuzzleBoard
from rcdn.types.arrays import Bool, Int, Real
from rcdn.types.target import PUZZLE

ACCEPT = 43.0
"""least evidence, bits: a false-positive probability of 10⁻⁶ (20 bits) over the 2²⁰ positions and orientations, of 8
pieces of boards"""
MARGIN = 20.0
"""bits by which it must exceed the next place"""
AGAINST = 0.08
"""largest share of clear circles of the other colour than the code's, relative to those of its colour"""
CAP = 3.0
"""largest log-likelihood ratio of a circle: one in twenty is hidden, dirty or overexposed"""
LEAST_SIGMA = 0.05
"""least standard deviation of a circle's grey, share of the squares' contrast"""
CODE_1 = (
    (
        "000010111000011101010101001000110101101100001110111000101001000100011111100000101011"
        "11110100110010010101110101110000111111011011010110011011111011100111101001111010001"
    ),
    (
        "011000011111101111111101000100100000111100010011000001000100011000011000000111000110"
        "10100011101110101101110110010010000110100110001110101000111000100110001111010100100"
    ),
    (
        "010000010100001110100001111010111110100000100100100001011101001101100111010110101100"
        "10110010010010110011001011110111001110000000101011011111010110110011000011110100011"
    ),
)
"""bits of the edges along y (CC0)"""
CODE_2 = (
    (
        "111110101001111110000101001101111001000001001100100111111000110100011101101001000010"
        "00111001111010000000100111000000010111110010110101111101110100101101011001001110010"
    ),
    (
        "101100110001001101011001110110000110101000100101010110000010110000001110000010110110"
        "00011111010101101101100011001111001001001010111011011001110011001011100011100011001"
    ),
    (
        "001100000101010001111010100101100001100100100000001100001111010001111011001010101001"
        "00101001011111101000000010110101101011111110001000111101011101100101000011011111111"
    ),
)
"""bits of the edges along x (CC0), rows in the order of the authors' board generator; their decoder lists them in
reverse order"""


def read_puzzle(grey: Array, grid: Array, seen: Array) -> Reading | None:
    """The position of a board on the PuzzleBoard; None if it is none, or if the position is not certain.

    `grid` (rows + 2, columns + 2, 2) px: its corners and a ring of predicted ones; `seen` (rows + 2, columns + 2) bool:
    the corners that were detected.
    """
    if _edges(seen) < ACCEPT:  # a circle provides at most one bit
        return None
    along_x, along_y = circles(grey, grid, seen)
    if not along_x.any() and not along_y.any():
        return None
    found = []
    for turns in range(4):
        x, y = _turned(along_x, along_y, turns)
        total = (
            np.tile(_votes(y, CODE_1), (PUZZLE // 3, 3)) + np.tile(_votes(x.T, CODE_2), (PUZZLE // 3, 3)).T
        )  # [row, column]
        best = int(total.argmax())
        bits = float(total.flat[best])
        total.flat[best] = -np.inf
        found.append((bits, float(total.max()), turns, best))
    found.sort(reverse=True)
    bits, second, turns, best = found[0]
    margin = bits - max(second, found[1][0])
    if bits < ACCEPT or margin < MARGIN:
        return None
    place = best % PUZZLE, best // PUZZLE
    return Reading(PuzzleBoard(), turns, place, bits, margin, _contradicted(along_x, along_y, turns, place))


def _turned(along_x: Array, along_y: Array, turns: int) -> tuple[Array, Array]:
    """The circles on the edges along x and along y, in the picture rotated by `turns` quarter turns."""
    x, y = (np.rot90(a, turns) for a in ((along_x, along_y) if turns % 2 == 0 else (along_y, along_x)))
    return x, y


def _contradicted(along_x: Array, along_y: Array, turns: int, place: tuple[int, int]) -> bool:
    """Whether too many of the clear circles have the other colour than the code at `place`: half of them do where a
    part of the board isn't there, such as that below the tear of a torn frame."""
    x, y = _turned(along_x, along_y, turns)
    both = ((y, CODE_1, place), (x.T, CODE_2, place[::-1]))
    signed = np.concatenate([(ratio * _colours(code, at, ratio.shape)).ravel() for ratio, code, at in both])
    return bool((signed <= -CAP).sum() > AGAINST * (signed >= CAP).sum())


def _colours(code: tuple[str, ...], at: tuple[int, int], shape: tuple[int, ...]) -> Int[Array, "r c"]:
    """Colours of the circles of `shape` (R, C) edges, the first of which is `at` (column, row) of the periodic `code`:
    1 white, −1 black."""
    bits = np.array([[int(bit) for bit in row] for row in code])
    row, column = np.indices(shape)
    return np.asarray(2 * bits[(row + at[1]) % len(bits), (column + at[0]) % bits.shape[1]] - 1)


def _edges(seen: Bool[Array, "r c"]) -> int:
    """The number of edges both of whose ends were `seen` (R, C)."""
    return int((seen[1:] & seen[:-1]).sum() + (seen[:, 1:] & seen[:, :-1]).sum())


def circles(grey: Array, grid: Array, found: Array) -> tuple[Array, Array]:
    """Log-likelihood ratios of white to black circles on the edges along x (rows, columns − 1) and along y
    (rows − 1, columns); 0 where no circle is visible, and everywhere if the board has none."""
    along_x = _ratio_to_sides(grey, grid, found)
    along_y = _ratio_to_sides(grey, grid.swapaxes(0, 1), found.T).T
    both = np.concatenate([along_x.ravel(), along_y.ravel()])
    both = both[np.isfinite(both)]
    level = float(np.median(np.abs(both))) if len(both) else 0.0
    if level < FAINT:
        return np.zeros_like(along_x), np.zeros_like(along_y)
    sigma = max(1.4826 * float(np.median(np.abs(np.abs(both) - level))), LEAST_SIGMA)
    x, y = (np.clip(np.nan_to_num(2 * a * level / sigma**2), -CAP, CAP) for a in (along_x, along_y))
    return x, y


def _ratio_to_sides(grey: Array, grid: Array, found: Array) -> Array:
    """(grey level at the middle of each edge along axis 1 − mean of both sides) ÷ contrast of the sides,
    (rows, columns − 1); `grid`: with its ring of predicted corners."""
    start, end = grid[1:-1, 1:-2], grid[1:-1, 2:-1]
    middle = (start + end) / 2
    above, below = ((grid[k, 1:-2] + grid[k, 2:-1]) / 2 for k in (slice(None, -2), slice(2, None)))
    disc = [(a, b) for a in (-0.09, 0.0, 0.09) for b in (-0.09, 0.0, 0.09)]
    centre = np.mean([_at(grey, middle + a * (end - start) + b * (below - above) / 2) for a, b in disc], axis=0)
    sides = [_at(grey, middle + 0.35 * (side - middle)) for side in (above, below)]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (centre - (sides[0] + sides[1]) / 2) / np.abs(sides[0] - sides[1])
    edge = found[1:-1, 1:-2] & found[1:-1, 2:-1]
    return np.where(edge & (np.abs(ratio) < 1.5), ratio, np.nan)


def _at(grey: Array, xy: Array) -> Array:
    at = np.nan_to_num(xy, nan=-1e6).astype(np.float32)
    return cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)


def _votes(ratio: Real[Array, "r c"], code: tuple[str, ...]) -> Real[Array, "3 167"]:
    """Evidence (3, 167), bits, for the first of the edges with log-likelihood `ratio` (R, C) being at each position of
    the periodic `code`."""
    bits = np.array([[int(bit) for bit in row] for row in code])
    white, black = (_folded(1 - np.logaddexp(0, -r) / np.log(2) * (r != 0) - (r == 0)) for r in (ratio, -ratio))
    spectrum = np.fft.fft2(bits) * np.conj(np.fft.fft2(white - black))
    return np.asarray(np.fft.ifft2(spectrum).real + black.sum())


def _folded(values: Array) -> Real[Array, "3 167"]:
    """`values` summed over all positions that are the same in the periodic code, (3, 167)."""
    out = np.zeros((3, 167))
    row, column = np.indices(values.shape)
    np.add.at(out, (row % 3, column % 167), values)
    return out
