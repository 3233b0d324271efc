"""Detects the sides on which a board visibly ends: its squares stop at an edge of the lattice, and the blank paper
continues.

A covered or cut board looks the same only if the occluder or the cut runs exactly along the edge of squares and what
lies beyond is as bright as the board's white.
"""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Bool, Real

LEAST_SHARE = 0.8
"""least share of a side's squares beyond which paper must be seen"""
OFF = 0.025
"""largest distance from the lattice's edge to the end of the dark squares, median of a side, squares"""
EACH = 0.06
"""the same for each single square"""
NEAR, FAR = 0.09, 0.41
"""range of the strip that must be paper, squares beyond the edge: printed margins are often only half a square wide"""
BLOCKS = 2, 4
"""number of blocks of the strip, outwards and along the side, each of which must be as bright as paper"""
BRIGHT = 0.75, 1.35
"""range of the brightness of paper, on a scale from the adjacent squares' dark, 0, to their white, 1"""
CLEAR = 0.7
"""least brightness just beyond a white square, where the next dark one would begin"""
LEAST_CONTRAST = 8.0
"""least contrast between dark and white, grey levels, with which a square is evaluated"""


def ended_sides(squares: Array, marked: Bool[Array, "r c"], contrast: float = 0.0) -> Bool[Array, "3 3"]:
    """(3, 3) bool: whether the board visibly ends above [0, 1], on the left [1, 0], on the right [1, 2] and below
    [2, 1]; False if that isn't known.

    `squares` (R + 2, C + 2, S, S): grey levels of the board's squares and of one more on each side, NaN outside the
    picture; `marked` (R, C): the squares that contain markers; `contrast` of dark and white without the blur, grey
    levels, 0 if that isn't known. The paper around inverted boards may be printed black.
    """
    ended = np.zeros((3, 3), bool)
    inner = squares[1:-1, 1:-1]
    black_on_white = _rim(inner[marked]) > _rim(inner[~marked])
    prints = [(squares, marked)] if black_on_white else [(squares, ~marked), (-squares, marked)]
    for print_, white in prints:
        lost = _lost(print_[1:-1, 1:-1], contrast) if white is marked else 1.0
        for turns in range(4):
            turned = np.rot90(np.rot90(print_, turns, (0, 1)), turns, (2, 3))
            np.rot90(ended, turns)[0, 1] |= _ends_above(turned, np.rot90(white, turns), lost)
    return ended


def _lost(squares: Array, contrast: float) -> float:
    """By which factor, at least 1, the `contrast` of dark and white exceeds that seen in `squares` (R, C, S, S): under
    blur the narrow rims of white around markers are darker than paper."""
    level = np.concatenate([_levels(row) for row in squares])
    seen = (level[:, 1] - level[:, 0])[np.isfinite(level[:, 0])]
    return max(1.0, contrast / max(float(np.median(seen)), LEAST_CONTRAST)) if len(seen) else 1.0


def _rim(squares: Array) -> float:
    """Median grey level along the edges of squares (K, S, S); NaN if none is visible."""
    values = np.concatenate([squares[:, :2].ravel(), squares[:, -2:].ravel()])
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else np.nan


def _ends_above(squares: Array, white: Bool[Array, "r c"], lost: float) -> bool:
    """Whether paper is seen above the board; `squares`: as in `ended_sides`; `white` (R, C): the squares with white at
    their edges; `lost`: by which factor paper may exceed their contrast of dark and white."""
    beyond, first, white = squares[0, 1:-1], squares[1, 1:-1], white[0]
    level = _levels(first)
    seen = np.isfinite(level).all(axis=1) & (level[:, 1] - level[:, 0] >= LEAST_CONTRAST)
    values = np.concatenate([beyond, first], axis=1)[seen]
    values = (values - level[seen, :1, None]) / (level[seen, 1] - level[seen, 0])[:, None, None]
    samples = values.shape[2]
    out = (samples - np.arange(2 * samples) - 0.5) / samples  # squares beyond the edge
    strip = (out > NEAR) & (out < FAR)
    values /= np.clip(np.nan_to_num(values[:, strip].mean(axis=(1, 2)), nan=1.0), 1.0, lost)[:, None, None]
    along = values[:, :, samples // 4 : -samples // 4].mean(axis=2)
    fine = _is_paper(values[:, strip])
    clear = along[:, (out > 0) & (out < NEAR)].min(axis=1, initial=np.inf) > CLEAR
    near = np.abs(out) < 0.3
    off = _end_of_dark(along[:, near], out[near])
    fine &= np.where(white[seen], clear, np.abs(off) < EACH)
    dark = fine & ~white[seen]
    return bool(fine.sum() >= LEAST_SHARE * len(seen) and dark.any() and abs(np.median(off[dark])) < OFF)


def _levels(squares: Array) -> Real[Array, "k 2"]:
    """Levels of dark and white (K, 2) in each of a row of squares (K, S, S) and its two neighbours; NaN where a square
    isn't fully visible."""
    flat = np.pad(squares.reshape(len(squares), -1), ((1, 1), (0, 0)), constant_values=np.nan)
    three = np.concatenate([flat[:-2], flat[1:-1], flat[2:]], axis=1)
    out = np.full((len(squares), 2), np.nan)
    known = np.isfinite(squares).all(axis=(1, 2))
    if known.any():
        out[known] = np.nanpercentile(three[known], (10, 96), axis=1).T
    return out


def _is_paper(strips: Array) -> Bool[Array, " k"]:
    """(K,) bool: whether strips (K, H, W), black 0 and white 1, are evenly bright."""
    inside = strips[:, :, strips.shape[2] // 10 : -(strips.shape[2] // 10)]
    blocks = [
        part.mean(axis=(1, 2))
        for rows in np.array_split(inside, BLOCKS[0], axis=1)
        for part in np.array_split(rows, BLOCKS[1], axis=2)
    ]
    return np.asarray((np.min(blocks, axis=0) > BRIGHT[0]) & (np.max(blocks, axis=0) < BRIGHT[1]))


def _end_of_dark(along: Array, out: Real[Array, " t"]) -> Real[Array, " k"]:
    """(K,): the outermost position of `out` (T,), falling, at which the profiles `along` (K, T), black 0 and white 1,
    change from dark to white; infinite if a profile is nowhere dark, or dark up to its outer end."""
    dark = along < 0.5
    last = dark.argmax(axis=1)  # the outermost dark sample
    known = dark.any(axis=1) & (last > 0)
    last = np.maximum(last, 1)
    k = np.arange(len(along))
    inner, outer = along[k, last], along[k, last - 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (0.5 - inner) / (outer - inner)
    return np.where(known, out[last] + share * (out[last - 1] - out[last]), np.inf)
