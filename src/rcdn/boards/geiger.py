"""Region growth after Geiger et al., ICRA 2012: directed neighbours, the energy of a lattice, growth by whole lines.

The paper's board recovery (`boards.paper`) builds on it. Positions only: no link is checked in the picture.
"""

from __future__ import annotations

import numpy as np

from rcdn.geometry.near import nearest
from rcdn.types import Array
from rcdn.types.arrays import Real

ACROSS = 5.0
"""Weight of the distance across the direction in the cost of a neighbour."""
CONE = np.deg2rad(25)
"""How far a neighbour may lie from the direction in which it is sought."""
NEAREST, NEAREST_TO_GUESS = 64, 24
"""Only this many nearest corners are considered, to bound the run time: around a corner, and around a prediction."""
AHEAD = 0.75
"""Share of the extrapolated step at which the next line is searched for: strong distortion shortens steps, and the
nearest corner wins."""


class Pool:
    """Corners that may be taken: `xy` (N, 2) px in a canonical order, independent of the input's, and `free` (N,) bool.

    `angles` (N, K): edge directions, radians in [0, π), NaN for none.
    """

    def __init__(self, xy: Array, angles: Array) -> None:
        self.xy, self.angles = xy, angles
        self.free = np.ones(len(xy), bool)
        self._near = nearest(xy, xy, min(NEAREST + 1, len(xy)))[1]
        self._ranked: dict[tuple[int, float], list[int]] = {}

    def neighbour(self, corner: int, angle: float) -> int | None:
        """The free corner of least cost d_par + 5 d_perp in the direction `angle` (radians, any range), within 25° of
        it."""
        ranked = self._ranked.get((corner, angle))
        if ranked is None:
            ranked = self._ranked[corner, angle] = self._rank(corner, angle)
        return next((other for other in ranked if self.free[other]), None)

    def toward(self, corner: int, angle: float) -> int | None:
        """The neighbour along the edge direction of `corner` closest to `angle`; along `angle` itself if none is within
        25°."""
        both = np.concatenate([self.angles[corner], self.angles[corner] + np.pi])
        turn = np.abs((both - angle + np.pi) % (2 * np.pi) - np.pi)
        best = int(np.where(np.isnan(turn), np.inf, turn).argmin())
        return self.neighbour(corner, float(both[best]) if turn[best] <= CONE else angle)

    def _rank(self, corner: int, angle: float) -> list[int]:
        near = self._near[corner]
        near = near[near != corner]
        step = self.xy[near] - self.xy[corner]
        along = step @ [np.cos(angle), np.sin(angle)]
        across = np.abs(step @ [-np.sin(angle), np.cos(angle)])
        inside = np.flatnonzero((along > 0) & (across <= np.tan(CONE) * along))
        order = np.lexsort((near[inside], (along + ACROSS * across)[inside]))
        return near[inside[order]].tolist()


def energy(lattice: Array) -> float:
    """E = −N (1 − the largest |x₁ + x₃ − 2x₂| / |x₁ − x₃| of any three in a row or column), positions (rows, columns,
    2).

    Geiger et al. 2012: a reward for each corner of a lattice, reduced by the relative bending of its worst triple.
    Lines of fewer than three corners have no bending.
    """
    worst = 0.0
    for lines in (lattice, lattice.swapaxes(0, 1)):
        if len(lines) >= 3:
            bend = np.linalg.norm(lines[:-2] + lines[2:] - 2 * lines[1:-1], axis=-1)
            span = np.linalg.norm(lines[2:] - lines[:-2], axis=-1)
            worst = max(worst, float((bend / np.maximum(span, 1e-9)).max()))
    return lattice.shape[0] * lattice.shape[1] * (worst - 1)


def grow_lines(pool: Pool, index: Array) -> Array:
    """Grow a whole lattice of corners by lines; `index` (rows, columns), both ≥ 3. Returns the larger lattice.

    Of the four sides, the one whose new line gives the least energy is extended, as long as the energy falls. Uses the
    pool's free corners outside the lattice; marks none of them as taken.
    """
    while True:
        now = energy(pool.xy[index])
        offers = [grown for side in range(4) if (grown := _with_line(pool, index, side)) is not None]
        best = min(offers, key=lambda grown: energy(pool.xy[grown]), default=None)
        if best is None or energy(pool.xy[best]) >= now:
            return index
        index = best


def _with_line(pool: Pool, index: Array, side: int) -> Array | None:
    """The lattice with one more line at its right, bottom, left or top (`side` 0..3); None if there are too few
    corners."""
    turned = np.rot90(index, side)  # the side that grows is the right one
    line = _assign(pool, _next_line(pool.xy[turned[:, -3:]]), index)
    if line is None:
        return None
    return np.rot90(np.column_stack([turned, line]), -side)


def _next_line(last: Array) -> Real[Array, "l 2"]:
    """Predicted positions of the next line (L, 2) from the last three (L, 3, 2): angle and length of the step are
    extrapolated linearly."""
    one, two = last[:, 1] - last[:, 0], last[:, 2] - last[:, 1]
    angle = 2 * np.arctan2(two[:, 1], two[:, 0]) - np.arctan2(one[:, 1], one[:, 0])
    length = 2 * np.linalg.norm(two, axis=1) - np.linalg.norm(one, axis=1)
    return np.asarray(last[:, 2] + AHEAD * length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _assign(pool: Pool, guess: Array, taken: Array) -> Real[Array, " l"] | None:
    """A corner (L,) for each prediction (L, 2), the closest pair first, none twice; None if one prediction has no
    corner."""
    distance, near = nearest(pool.xy, guess, min(NEAREST_TO_GUESS, len(pool.xy)))
    able = pool.free[near] & ~np.isin(near, taken)
    row = np.broadcast_to(np.arange(len(guess))[:, None], near.shape)[able]
    out, used = np.full(len(guess), -1), set()
    for k in np.lexsort((near[able], row, distance[able])).tolist():
        corner = int(near[able][k])
        if out[row[k]] < 0 and corner not in used:
            out[row[k]] = corner
            used.add(corner)
    return out if (out >= 0).all() else None
