"""Lattices whose steps are long and short in turn, as on AprilGrids: the small squares between tags are part of the tag's side.

The link graph and the flood fill know no pitch, so that such a grid is labelled like any other. What differs is where the next corner lies: on the
printed plane the corner (u, v) is at (place(u), place(v)), place(u) = ⌊u/2⌋ (1 + gap) + (u mod 2), in sides of a tag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.boards.graph import Field, Label
from rcdn.geometry import homography
from rcdn.geometry.near import nearest
from rcdn.types import Array

UNEVEN = 1.5
"""ratio of neighbouring steps from which on a lattice alternates"""
AGREE = 0.85
"""share of the steps that must alternate alike"""
LEAST = 12
"""corners of a grid that can be told to alternate"""
REACHES = (1.4, 2.4)
"""sides of a tag within which corners predict the next one; the second where the first has too few"""
FEW = 8
"""corners that are too few for a prediction"""
NEAR = 0.35
"""how far from its predicted place a corner may lie, gaps"""


@dataclass(frozen=True)
class Alternating:
    """A grid {(u, v): corner} whose long steps begin at even u and v; `gap`: short over long step."""

    at: dict[Label, int]
    gap: float


def alternating(field: Field, grid: dict[Label, int]) -> Alternating | None:
    """The grid with its labels moved so that long steps begin at even ones; None if its steps don't alternate along both axes."""
    if len(grid) < LEAST:
        return None
    shift, ratios = [], []
    for axis in (0, 1):
        turn = _alternation(field.xy, grid, axis)
        if len(turn) < LEAST // 3:
            return None
        sign = np.sign(np.median(turn))
        if (turn * sign > np.log(UNEVEN)).mean() < AGREE:
            return None
        shift.append(0 if sign > 0 else 1)
        ratios.append(float(np.exp(-abs(np.median(turn)))))
    at = {(u + shift[0], v + shift[1]): corner for (u, v), corner in grid.items()}
    return Alternating(at, float(np.sqrt(ratios[0] * ratios[1])))


def _alternation(xy: Array, grid: dict[Label, int], axis: int) -> Array:
    """log(step before ÷ step after) of corners with two neighbours along an axis, sign changed where the step before begins at an odd label."""
    out = []
    for (u, v), corner in grid.items():
        before = grid.get((u - 1, v) if axis == 0 else (u, v - 1))
        after = grid.get((u + 1, v) if axis == 0 else (u, v + 1))
        if before is None or after is None:
            continue
        one, two = np.linalg.norm(xy[corner] - xy[before]), np.linalg.norm(xy[after] - xy[corner])
        first = (u, v)[axis] - 1
        out.append(np.log(one / two) * (1 - 2 * (first % 2)))
    return np.array(out)


def place(labels: Array, gap: float) -> Array:
    """Where labels (..., 2) lie on the printed plane, sides of a tag."""
    labels = np.asarray(labels)
    return np.asarray(labels // 2 * (1 + gap) + labels % 2)


def complete(field: Field, grid: Alternating, free: Array) -> Alternating:
    """The grid with all corners that lie where it goes on, as far as they are `free` (N,) bool; corners that don't lie where the others say are dropped."""
    at = dict(grid.at)
    usable = np.flatnonzero(free)
    for _ in range(100):
        spots = sorted({s for u, v in at for s in ((u + 1, v), (u - 1, v), (u, v + 1), (u, v - 1))} - at.keys())
        taken = set(at.values())
        new: dict[Label, int] = {}
        for spot in spots:
            found = _corner_at(field, at, grid.gap, spot, usable)
            if found is not None and found not in taken:
                new[spot] = found
                taken.add(found)
        if not new:
            break
        at |= new
    kept = {spot: corner for spot, corner in at.items() if _agrees(field, at, grid.gap, spot)}
    return Alternating(kept, grid.gap)


def _predicted(field: Field, at: dict[Label, int], gap: float, spot: Label) -> tuple[Array, float] | None:
    """Where the corner of a spot should be, px, by the corners around it, and the gap there, px; None if they are too few."""
    labels = np.array([label for label in at if label != spot])
    where, here = place(labels, gap), place(np.array(spot), gap)
    far = np.abs(where - here).max(axis=1)
    close = next((c for reach in REACHES if (c := far < reach).sum() >= FEW and np.ptp(labels[c], axis=0).min() > 0), None)
    if close is None:
        return None
    xy = field.xy[[at[tuple(label)] for label in labels[close].tolist()]]
    try:
        to_picture = homography(where[close] - here, xy)
    except np.linalg.LinAlgError:
        return None
    spots = np.array([[0, 0, 1], [gap, 0, 1], [0, gap, 1]]) @ to_picture.T
    if not (np.abs(spots[:, 2]) > 1e-9).all():
        return None
    spots = spots[:, :2] / spots[:, 2:]
    return spots[0], float(min(np.linalg.norm(spots[1:] - spots[0], axis=1)))


def _corner_at(field: Field, at: dict[Label, int], gap: float, spot: Label, usable: Array) -> int | None:
    guess = _predicted(field, at, gap, spot)
    if guess is None:
        return None
    distance, row = nearest(field.xy[usable], guess[0][None])
    return int(usable[row[0, 0]]) if distance[0, 0] < NEAR * guess[1] else None


def _agrees(field: Field, at: dict[Label, int], gap: float, spot: Label) -> bool:
    guess = _predicted(field, at, gap, spot)
    return guess is not None and float(np.linalg.norm(field.xy[at[spot]] - guess[0])) < NEAR * guess[1]
