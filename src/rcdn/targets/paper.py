"""Where a board is seen to end: its squares stop at an edge of the lattice, and the plain paper that they are printed
on goes on.

A board that is covered or cut shows the same only if that happens along the very edge of squares, and what is beyond is
as bright as its white.
"""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

MOST = 0.8
"""least share of a side's squares beyond which paper is seen"""
OFF = 0.025
"""squares; how far from the lattice's edge the dark squares may end, median of a side"""
EACH = 0.06
"""the same of each square"""
NEAR, FAR = 0.09, 0.41
"""the strip that must be paper, squares beyond the edge: drawings often have no more than half a square"""
BLOCKS = 2, 4
"""parts of the strip, outwards and along the side, each of which must be as bright as paper"""
BRIGHT = 0.75, 1.35
"""brightness of paper, from the dark of the squares beside it, 0, to their white, 1"""
CLEAR = 0.7
"""least brightness right beyond a white square, where the next dark one would begin"""
LEAST = 8.0
"""grey levels from dark to white under which nothing is known"""


def ended_sides(squares: Array, marked: Bool[Array, "r c"]) -> Bool[Array, "3 3"]:
    """(3, 3) bool: whether the board is seen to end above [0, 1], on the left [1, 0], on the right [1, 2] and below [2,
    1]; else it isn't known.

    `squares` (R + 2, C + 2, S, S): grey of the board's squares and of one more on each side, NaN where nothing is seen;
    `marked` (R, C): those that hold markers. Around inverted boards paper may be printed black.
    """
    ended = np.zeros((3, 3), bool)
    inner = squares[1:-1, 1:-1]
    black_on_white = _rim(inner[marked]) > _rim(inner[~marked])
    prints = [(squares, marked)] if black_on_white else [(squares, ~marked), (-squares, marked)]
    for turns in range(4):
        np.rot90(ended, turns)[0, 1] = any(
            _ends_above(np.rot90(np.rot90(s, turns, (0, 1)), turns, (2, 3)), np.rot90(w, turns)) for s, w in prints
        )
    return ended


def _rim(squares: Array) -> float:
    """Usual grey along the edges of squares (K, S, S); NaN where nothing is seen."""
    values = np.concatenate([squares[:, :2].ravel(), squares[:, -2:].ravel()])
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else np.nan


def _ends_above(squares: Array, white: Bool[Array, "r c"]) -> bool:
    """Whether paper is seen above the board's `squares`, with those above them; `white` (R, C): those with white at
    their edges."""
    beyond, first, white = squares[0, 1:-1], squares[1, 1:-1], white[0]
    level = _levels(first)
    seen = np.isfinite(level).all(axis=1) & (level[:, 1] - level[:, 0] >= LEAST)
    values = np.concatenate([beyond, first], axis=1)[seen]
    values = (values - level[seen, :1, None]) / (level[seen, 1] - level[seen, 0])[:, None, None]
    samples = values.shape[2]
    out = (samples - np.arange(2 * samples) - 0.5) / samples  # squares beyond the edge
    along = values[:, :, samples // 4 : -samples // 4].mean(axis=2)
    fine = _is_paper(values[:, (out > NEAR) & (out < FAR)])
    clear = along[:, (out > 0) & (out < NEAR)].min(axis=1, initial=np.inf) > CLEAR
    near = np.abs(out) < 0.3
    off = _end_of_dark(along[:, near], out[near])
    fine &= np.where(white[seen], clear, np.abs(off) < EACH)
    dark = fine & ~white[seen]
    return bool(fine.sum() >= MOST * len(seen) and dark.any() and abs(np.median(off[dark])) < OFF)


def _levels(squares: Array) -> Real[Array, "k 2"]:
    """Dark and white (K, 2) of a row of squares (K, S, S) and of those beside each; NaN where a square isn't all
    seen."""
    flat = np.pad(squares.reshape(len(squares), -1), ((1, 1), (0, 0)), constant_values=np.nan)
    three = np.concatenate([flat[:-2], flat[1:-1], flat[2:]], axis=1)
    out = np.full((len(squares), 2), np.nan)
    known = np.isfinite(squares).all(axis=(1, 2))
    if known.any():
        out[known] = np.nanpercentile(three[known], (10, 96), axis=1).T
    return out


def _is_paper(strips: Array) -> Bool[Array, " k"]:
    """(K,) bool: which strips (K, H, W), black 0 and white 1, are evenly bright."""
    inside = strips[:, :, strips.shape[2] // 10 : -(strips.shape[2] // 10)]
    blocks = [
        part.mean(axis=(1, 2))
        for rows in np.array_split(inside, BLOCKS[0], axis=1)
        for part in np.array_split(rows, BLOCKS[1], axis=2)
    ]
    return np.asarray((np.min(blocks, axis=0) > BRIGHT[0]) & (np.max(blocks, axis=0) < BRIGHT[1]))


def _end_of_dark(along: Array, out: Real[Array, " t"]) -> Real[Array, " k"]:
    """(K,): how far `out` (T,), falling, profiles (K, T) of black 0 and white 1 are last dark; infinite if they aren't,
    or don't end."""
    dark = along < 0.5
    last = dark.argmax(axis=1)  # the outermost
    known = dark.any(axis=1) & (last > 0)
    last = np.maximum(last, 1)
    k = np.arange(len(along))
    inner, outer = along[k, last], along[k, last - 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (0.5 - inner) / (outer - inner)
    return np.where(known, out[last] + share * (out[last - 1] - out[last]), np.inf)
