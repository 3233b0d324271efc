"""The paper's board recovery (section 3.4): initial matrices of 3 × 3 or 2 × 2 corners, grown by lines or by cells.

Kept beside the link graph (`find_boards`) so that the paper's claims can be verified; docs/recovery.md shows where it
fails.
"""

from __future__ import annotations

from collections import deque
from itertools import combinations

import numpy as np

from rcdn.boards.convert import as_board, as_field
from rcdn.boards.geiger import Pool, energy, grow_lines
from rcdn.boards.local import Grid
from rcdn.corners import Candidates
from rcdn.corners.histogram import edge_directions
from rcdn.geometry.rules import Label
from rcdn.types import Array, Board
from rcdn.types.arrays import Real, Shaped

DIRECTIONS = (2, 4)
"""least and largest number of edge directions of a corner from which a board may start"""
APART = 0.3
"""least angle between the two directions of a lattice, radians"""
UNEVEN = 0.3
"""largest standard deviation ÷ mean of the steps along one direction of a 3 × 3 matrix"""
START_ENERGY = -6.0
"""largest energy of an initial 3 × 3 matrix"""
RATIO = (0.8, 1.2)
"""range of the mean edge of a cell ÷ mean edge of the initial cell for cells to merge (the paper's values)"""
QUADRANTS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
"""Diagonals of a 3 × 3 matrix, clockwise on the screen."""
CELL = 4
"""corners of the smallest board"""
Labels = dict[Label, int]


def find_boards_paper(grey: Shaped[Array, "h w"], candidates: Candidates, least: int = CELL) -> list[Board]:
    """Boards among the corners above the threshold by the paper's growth, the one with the most corners first.

    As `find_boards`: `grey` (H, W), `least` the fewest corners of a board, labels by docs/conventions.md, [] for no
    board. The result does not depend on the order of the candidates. Paper section 3.4; details that the paper leaves
    open are documented in docs/paper.md, P17.
    """
    found = candidates.all
    index = np.flatnonzero(candidates.sure)
    index = index[np.lexsort((found.xy[index, 1], found.xy[index, 0], -found.response[index]))]
    angles, count = edge_directions(grey, found.xy[index])
    field = as_field(grey, candidates)
    grids = [
        Grid({spot: int(index[c]) for spot, c in at.items()}, found.xy)
        for at in recover(found.xy[index], angles, count)
    ]
    boards = [as_board(field, candidates, grid) for grid in grids if len(grid) >= least]
    return sorted(boards, key=lambda b: (-len(b), *b.xy[0]))


def recover(xy: Real[Array, "n 2"], angles: Array, count: Array) -> list[Labels]:
    """Grids {(u, v): corner} of corners `xy` (N, 2), sorted by falling response, with `angles`, `count` of
    `edge_directions`.

    First all boards that grow by lines from 3 × 3 corners, then boards that grow by cells among the remaining corners:
    a corner at the rim has no 3 × 3 neighbourhood, and growth by cells ends where perspective changes their size.
    Within each stage, seeds are tried by falling response. Labels are right-handed, with arbitrary origin. Each corner
    is in at most one board.
    """
    grids: list[Labels] = []
    if len(xy) < CELL:
        return grids
    pool = Pool(xy, angles)
    seeds = np.flatnonzero((count >= DIRECTIONS[0]) & (count <= DIRECTIONS[1])).tolist()
    for start in (_lines_at, _cells_at):
        for seed in seeds:
            if pool.free.sum() < CELL:
                return grids
            grid = start(pool, seed) if pool.free[seed] else None
            if grid:
                pool.free[list(grid.values())] = False
                grids.append(grid)
    return grids


def _matrices_at(pool: Pool, seed: int) -> list[Labels]:
    """The initial matrix for each pair of the seed's edge directions."""
    own = [float(a) for a in pool.angles[seed] if np.isfinite(a)]
    pairs = [(min(p), max(p)) for p in combinations(own, 2)]
    return [start_matrix(pool, seed, a, b) for a, b in pairs if APART <= b - a <= np.pi - APART]


def _lines_at(pool: Pool, seed: int) -> Labels | None:
    """The board grown by lines from the first suitable matrix of 3 × 3 corners around `seed`; None if there is none."""
    for at in _matrices_at(pool, seed):
        if len(at) == 9 and even(pool, index := np.array([[at[u, v] for u in (-1, 0, 1)] for v in (-1, 0, 1)])):
            grown = grow_lines(pool, index)
            return {(u, v): int(corner) for (v, u), corner in np.ndenumerate(grown)}
    return None


def _cells_at(pool: Pool, seed: int) -> Labels | None:
    """The board grown by cells from the first convex cell at `seed`; None if there is none."""
    for at in _matrices_at(pool, seed):
        for u, v in QUADRANTS:
            ring = _ring((min(u, 0), min(v, 0)))
            if all(spot in at for spot in ring) and _convex(pool.xy[[at[spot] for spot in ring]]):
                return _grow_cells(pool, {spot: at[spot] for spot in ring}, ring[0])
    return None


def start_matrix(pool: Pool, seed: int, a: float, b: float) -> Labels:
    """Corners at labels −1..1 around `seed`: columns run along the angle `a`, rows along `b`, a < b.

    The neighbours of the seed, then their neighbours: a diagonal corner is accepted if both paths to it end at the same
    corner. No corner appears twice.
    """
    at, along, down = {(0, 0): seed}, {1: a, -1: a + np.pi}, {1: b, -1: b + np.pi}
    for k in (1, -1):
        for spot, angle in (((k, 0), along[k]), ((0, k), down[k])):
            side = pool.neighbour(seed, angle)
            if side is not None and side not in at.values():
                at[spot] = side
    for u, v in QUADRANTS:
        if (u, 0) in at and (0, v) in at:
            one, other = pool.toward(at[u, 0], down[v]), pool.toward(at[0, v], along[u])
            if one is not None and one == other and one not in at.values():
                at[u, v] = one
    return at


def even(pool: Pool, index: Array) -> bool:
    """Whether growth may start from a 3 × 3 matrix of corners (rows, columns): even steps along each direction, nearly
    straight lines."""
    xy = pool.xy[index]
    steps = [np.linalg.norm(np.diff(xy, axis=axis), axis=-1) for axis in (0, 1)]
    cells = np.stack([xy[:-1, :-1], xy[:-1, 1:], xy[1:, 1:], xy[1:, :-1]], axis=2)
    return _convex(cells) and all(s.std() <= UNEVEN * s.mean() for s in steps) and energy(xy) <= START_ENERGY


def _convex(quads: Array) -> bool:
    """Whether all quads (..., 4, 2) are convex and clockwise on the screen."""
    edge = np.roll(quads, -1, axis=-2) - quads
    after = np.roll(edge, -1, axis=-2)
    return bool((edge[..., 0] * after[..., 1] > edge[..., 1] * after[..., 0]).all())


def _grow_cells(pool: Pool, at: Labels, first: Label) -> Labels:
    """Add cells beside the edges of cells, starting from the cell of least label `first`, while they are about as large
    as it.

    The paper's literal rule: mean edge ÷ mean edge of the initial cell in [0.8, 1.2]. Cells that contradict a label are
    left out.
    """
    size = _mean_edge(pool.xy[[at[spot] for spot in _ring(first)]])
    where = {corner: spot for spot, corner in at.items()}
    done, queue = {first}, deque([first])
    while queue:
        u, v = queue.popleft()
        for d, e in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            cell = (u + d, v + e)
            if cell in done:
                continue
            new = _beside(pool, at, where, (u, v), (d, e))
            if not new:
                continue
            quad = pool.xy[[(at | new)[spot] for spot in _ring(cell)]]
            if _convex(quad) and RATIO[0] <= _mean_edge(quad) / size <= RATIO[1]:
                at |= new
                where |= {corner: spot for spot, corner in new.items()}
                done.add(cell)
                queue.append(cell)
    return at


def _ring(cell: Label) -> list[Label]:
    """Labels of the corners of a cell given by its least label; clockwise on the screen."""
    u, v = cell
    return [(u, v), (u + 1, v), (u + 1, v + 1), (u, v + 1)]


def _mean_edge(quad: Array) -> float:
    return float(np.linalg.norm(quad - np.roll(quad, 1, axis=0), axis=1).mean())


def _beside(pool: Pool, at: Labels, where: dict[int, Label], cell: Label, step: Label) -> Labels | None:
    """The two corners beyond the edge of `cell` that faces `step`, {label: corner}; None if there is no cell.

    Found like the initial matrix: outward from both ends of the edge, and from each of the two to the other. Both paths
    must agree with each other and with existing labels.
    """
    d, e = step
    near = [spot for spot in _ring(cell) if (spot[0] - d, spot[1] - e) in _ring(cell)]
    out: list[int] = []
    for u, v in near:
        corner = pool.toward(at[u, v], _angle(pool, at[u - d, v - e], at[u, v]))
        spot = (u + d, v + e)
        if corner is None or at.get(spot, corner) != corner or where.get(corner, spot) != spot:
            return None
        out.append(corner)
    edge = _angle(pool, at[near[0]], at[near[1]])
    if pool.toward(out[0], edge) != out[1] or pool.toward(out[1], edge + np.pi) != out[0]:
        return None
    return {(u + d, v + e): corner for (u, v), corner in zip(near, out, strict=True)}


def _angle(pool: Pool, start: int, end: int) -> float:
    dx, dy = pool.xy[end] - pool.xy[start]
    return float(np.arctan2(dy, dx))
