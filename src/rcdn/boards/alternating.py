"""Lattices with alternating long and short steps, as on AprilGrids: tags, and small squares between their corners.

The link graph and the flood fill assume no pitch, so that such a grid is labelled like any other. What differs is the
prediction of the next corner: on the printed plane (`plane_points`) u is at ⌊u / 2⌋ (1 + gap) + (u mod 2), in sides of
a tag, and v likewise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.boards.graph import Field
from rcdn.boards.local import assign, parts, spots_beside
from rcdn.geometry import homography
from rcdn.geometry.division import Division, division_of
from rcdn.geometry.elementary import exp, log
from rcdn.geometry.matrices import product
from rcdn.geometry.median import median
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import TAGS, Label
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real
from rcdn.types.plane import plane_points

UNEVEN = float(log(1.5))
"""least log of the ratio of neighbouring steps at which a lattice counts as alternating"""
AGREE = 0.85
"""least share of the steps that must alternate in the same phase"""
LEAST_CORNERS = 12
"""fewest corners of a grid for a decision on whether its steps alternate"""
TRIPLES = 8
"""fewest corners with a neighbour on both sides for that decision, both axes together"""
ENOUGH = 400
"""largest number of corners per axis used for that decision"""
REACHES = (1.4, 2.4)
"""radius of the neighbourhood that predicts the next corner, sides of a tag; the second where the first has too few"""
FEW = 8
"""fewest corners that a prediction needs"""
NEAR, NEAR_WEAK = 0.35, 0.2
"""largest distance of a corner from its prediction, gaps; the second, applied at the end, for corners of weak
response"""
WEAK = 0.75
"""response below which a corner counts as weak, share of the board's median"""
ROUNDS = 100
"""largest number of rounds of growth, each by one corner to every side"""


def alternating(field: Field, grids: list[dict[Label, int]], free: Bool[Array, " n"]) -> list[dict[Label, int]]:
    """The grids among `grids` with alternating steps, completed, labelled so that long steps begin at even labels.

    Of each grid only the corners that are `free` (N,) bool are used. The corners of the lattices are marked as taken.
    """
    out, strips = [], []
    for grid in grids:
        phases = _evened(field.xy, _left(grid, free))
        if len(phases) == 1:
            out += _taken(field, phases, free)
        elif phases:
            strips.append(grid)
    for grid in strips:  # last, since grids with more lines are surer
        out += _taken(field, _evened(field.xy, _left(grid, free)), free)
    return out


def _left(grid: dict[Label, int], free: Bool[Array, " n"]) -> dict[Label, int]:
    return {spot: corner for spot, corner in grid.items() if free[corner]}


def _taken(
    field: Field, phases: list[tuple[dict[Label, int], float]], free: Bool[Array, " n"]
) -> list[dict[Label, int]]:
    """The completed grid of the phase that gives most corners, which are marked as taken; [] if there are too few."""
    whole = max((_completed(field, *phase, free) for phase in phases), key=len, default={})
    free[list(whole.values())] = False
    return [whole] if len(whole) >= LEAST_CORNERS else []


def _evened(xy: Array, at: dict[Label, int]) -> list[tuple[dict[Label, int], float]]:
    """The grid with long steps at even labels, and the gap (short step ÷ long step); for both phases of an axis along
    which it has two lines only, as steep grids have between rows of tags.

    [] if its steps do not alternate along the others.
    """
    shifts: list[tuple[int, ...]] = []
    sizes, count = [], 0
    for axis, step in enumerate(TAGS.steps[:2] if len(at) >= LEAST_CORNERS else ()):
        ratio = _ratios(xy, at, step)
        typical = median(ratio) if len(ratio) > 1 else 0.0
        if not len(ratio) and len({spot[axis] for spot in at}) == 2:
            shifts.append((0, 1))
            continue
        if abs(typical) < UNEVEN or (ratio * np.sign(typical) > UNEVEN).mean() < AGREE:
            return []
        shifts.append((0,) if typical > 0 else (1,))
        sizes.append(abs(typical))
        count += len(ratio)
    if count < TRIPLES:
        return []
    gap = float(exp(-sum(sizes) / len(sizes)))
    return [({(u + a, v + b): corner for (u, v), corner in at.items()}, gap) for a in shifts[0] for b in shifts[1]]


def _ratios(xy: Array, at: dict[Label, int], step: Label) -> Array:
    """log(previous step ÷ next step) at the corners with a neighbour on both sides, along `step`.

    The sign is flipped at even labels, whose previous step begins at an odd one.
    """
    triples = []
    for (u, v), corner in at.items():
        before, after = at.get((u - step[0], v - step[1])), at.get((u + step[0], v + step[1]))
        if before is not None and after is not None:
            triples.append((before, corner, after, (u * step[0] + v * step[1]) % 2))
        if len(triples) == ENOUGH:
            break
    if not triples:
        return np.zeros(0)
    before, corner, after, odd = np.array(triples).T
    one, two = (np.linalg.norm(xy[a] - xy[b], axis=1) for a, b in ((corner, before), (after, corner)))
    return log(np.maximum(one, 1e-9) / np.maximum(two, 1e-9)) * np.where(odd, 1.0, -1.0)


def _completed(field: Field, at: dict[Label, int], gap: float, free: Bool[Array, " n"]) -> dict[Label, int]:
    """The grid grown by all `free` (N,) corners at predicted positions, without corners that their neighbours
    contradict.

    Only the largest connected part of it is kept, and grown again: where neighbours contradict each other all along a
    line, the labels beyond it may be shifted by a tag.
    """
    for _ in range(ROUNDS):
        grown, places = _grown(field, at, gap, free)
        weak = WEAK * median(field.response[list(grown.values())])
        near = {spot: NEAR_WEAK if field.response[corner] < weak else NEAR for spot, corner in grown.items()}
        agreed = {spot for spot in grown if _agrees(places, grown, gap, spot, near[spot])}
        kept = next(iter(parts(agreed, TAGS.steps)), set())  # the largest
        before, at = at, {spot: corner for spot, corner in grown.items() if spot in kept}
        if len(kept) == len(agreed) or not at or at.keys() == before.keys():
            break
    return at


def _grown(field: Field, at: dict[Label, int], gap: float, free: Bool[Array, " n"]) -> tuple[dict[Label, int], _Places]:
    """The grid with all `free` (N,) corners at predicted positions, and where its corners are."""
    at, open_ = dict(at), free.copy()
    open_[list(at.values())] = False
    usable = np.flatnonzero(free & (field.fit > 0))
    places = _Places.of(field, at, gap)
    for _ in range(ROUNDS if len(usable) else 0):
        offers = []
        for spot in spots_beside(at, TAGS.steps):  # each takes its nearest corner, in the order of their labels
            guess = _predicted(places, at, gap, spot)
            if guess is not None:
                distance, row = nearest(field.xy[usable], guess[0][None])
                if distance[0, 0] < NEAR * guess[1]:
                    offers.append((0.0, spot, int(usable[row[0, 0]])))
        if not assign(at, open_, offers):
            break
        places = _Places.of(field, at, gap)
    return at, places


@dataclass(frozen=True, eq=False)
class _Places:
    """Where corners are, `xy` (N, 2) px, and would be without the `lens`, `flat` (N, 2) px; the same if no lens is seen
    to distort the board."""

    xy: Array
    flat: Array
    lens: Division | None

    @classmethod
    def of(cls, field: Field, at: dict[Label, int], gap: float) -> _Places:
        corners = list(at.values())
        lens = division_of(
            plane_points(np.array(list(at)), TAGS.pattern, gap), field.xy[corners], field.grey.shape[::-1]
        )
        flat = field.xy
        if lens is not None:
            flat = field.xy.copy()
            flat[corners] = lens.undistorted(field.xy[corners])
        return cls(field.xy, flat, lens)


def _agrees(places: _Places, at: dict[Label, int], gap: float, spot: Label, near: float) -> bool:
    guess = _predicted(places, at, gap, spot)
    return guess is not None and float(np.linalg.norm(places.xy[at[spot]] - guess[0], axis=0)) < near * guess[1]


def _predicted(places: _Places, at: dict[Label, int], gap: float, spot: Label) -> tuple[Array, float] | None:
    """Predicted position of the corner at a spot, px, from the corners around it, and the gap there, px.

    None if there are too few corners.
    """
    near = [
        (u, v)
        for u in range(spot[0] - 4, spot[0] + 5)
        for v in range(spot[1] - 4, spot[1] + 5)
        if (u, v) != spot and (u, v) in at
    ]
    if len(near) < FEW:
        return None
    labels = np.array(near)
    where, here = (plane_points(ij, TAGS.pattern, gap) for ij in (labels, np.array(spot)))
    far = np.abs(where - here).max(axis=1)
    close = next(
        (c for reach in REACHES if (c := far < reach).sum() >= FEW and np.ptp(labels[c], axis=0).min() > 0), None
    )
    if close is None:
        return None
    known = places.flat[[at[u, v] for u, v in labels[close].tolist()]]
    found = corner_and_gaps(where[close] - here, known, gap, places.lens)
    return None if found is None else (found[0], float(np.linalg.norm(found[1:] - found[0], axis=1).min()))


def corner_and_gaps(
    printed: Real[Array, "k 2"], flat: Real[Array, "k 2"], gap: float, lens: Division | None
) -> Real[Array, "3 2"] | None:
    """Where the origin of the print is in the picture, and the points a `gap` beyond it along both axes, (3, 2) px, by
    the homography of corners at `printed` (K, 2), sides of a tag, which are at `flat` (K, 2) px without the `lens`.

    None if there is no such homography.
    """
    try:
        to_picture = homography(printed, flat)
    except np.linalg.LinAlgError:
        return None
    spots = product(np.array([[0.0, 0, 1], [gap, 0, 1], [0, gap, 1]]), to_picture.T)
    if not (np.abs(spots[:, 2]) > 1e-9).all():
        return None
    spots = spots[:, :2] / spots[:, 2:]
    return np.asarray(spots if lens is None else lens.distorted(spots))
